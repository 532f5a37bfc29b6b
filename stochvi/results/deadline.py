"""Progress and deadlines. Chapters: the progress of a calculation, and its display in notebooks;
when a calculation with a budget must end."""

from __future__ import annotations

import html
import math
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field, is_dataclass, replace
from threading import Lock
from typing import Any, TypeVar

from stochvi.engine.late_exceptions import raise_late
from stochvi.results.errors import Interrupted, NotConverged

# ------------------------------------------------------------------------------
# Progress of a calculation: the function that is called with it, and its display in notebooks.
# ------------------------------------------------------------------------------


Progress = Callable[[float, str], None]
"""A function that is called with the fraction done (0 to 1) and a sentence about the progress."""

FIRST_SECONDS = 1.0
"""Seconds after which a notebook shows the progress of a calculation: in a shorter calculation the
display would only blink."""

NEXT_SECONDS = 0.2
"""Seconds between two updates of the display in a notebook."""

_CELL = Lock()
"""Lock that is held while a notebook shows the progress of a calculation. Calculations that it
calls then do not show theirs."""


def part_of(progress: Progress | None, low: float, high: float, words: str = "") -> Progress | None:
    """Progress of a part of a calculation, whose fraction goes from `low` to `high` while that of
    the part goes from 0 to 1; its sentences follow some words.

    >>> part_of(lambda done, text: print(f"{done:.2f} {text}"), 0.5, 0.7, "row 2")(0.5, "8 paths")
    0.60 row 2, 8 paths
    """
    if progress is None:
        return None

    def tell(done: float, text: str) -> None:
        progress(low + (high - low) * done, ", ".join(each for each in (words, text) if each))

    return tell


class Pace:
    """Progress as a sentence, with the time left.

    The time left follows from the rate at which the fraction has grown since the first report. The
    first report may come late, and of a resumed run its fraction may already be large.

    Examples
    --------
    >>> Pace("size")(0.25, "first crossings")
    'size: 25 %, first crossings'
    """

    def __init__(self, title: str) -> None:
        self.title = title
        self.first: tuple[float, float] | None = None

    def left(self, done: float) -> float:
        """Seconds that are left if the fraction `done` (0 to 1) is done; infinite if not known."""
        now = time.monotonic()
        began, before = self.first = self.first or (now, done)
        return (1.0 - done) * (now - began) / (done - before) if done > before else math.inf

    def __call__(self, done: float, text: str) -> str:
        left = self.left(done)
        words = f", {left:.0f} s left" if math.isfinite(left) else ""
        return f"{self.title}: {100.0 * done:.0f} %, {text}{words}"


_announcers: list[Callable[[str], None]] = []
"""Displays of the calculations under way, outermost first."""


@contextmanager
def showing(progress: Progress | None) -> Iterator[Progress | None]:
    """Show there, too, what is announced within the `with` block; None changes nothing.

    Yields what the calculation calls instead: it keeps the fraction that was done last.
    """
    if progress is None:
        yield None
        return
    last = [0.0]

    def show(done: float, text: str) -> None:
        last[0] = done
        progress(done, text)

    def say(text: str) -> None:
        progress(last[0], text)

    _announcers.append(say)
    try:
        yield show
    finally:
        _announcers.remove(say)


def announce(text: str) -> None:
    """Show a sentence where the innermost calculation under way shows its progress.

    A progress that ends its calculation by an exception does so at the next report: here, beside
    the calculation, nobody would catch it.
    """
    if _announcers:
        with suppress(Exception):
            _announcers[-1](text)


@contextmanager
def shown_in_notebooks(title: str, progress: Progress | None) -> Iterator[Progress | None]:
    """Progress of a calculation in a notebook, if its argument `progress` was left out.

    Outside notebooks the calculation stays silent, as programs expect it.
    """
    display = _display_of_notebook()
    if display is None or progress or not _CELL.acquire(blocking=False):
        yield progress
        return
    bar = _Bar(title, display)
    try:
        yield bar
    finally:
        bar.clear()
        _CELL.release()


def _display_of_notebook() -> Callable[..., Any] | None:
    """The function `display` of the notebook that runs this process, None where there is none."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    if getattr(shell, "kernel", None) is None:
        return None
    # a notebook shows HTML without further packages; bars of rich and tqdm need ipywidgets
    from IPython.display import display

    shown: Callable[..., Any] = display
    return shown


class _Bar:
    """A bar and a sentence in the output of a cell, removed when the calculation ends."""

    def __init__(self, title: str, display: Callable[..., Any]) -> None:
        self.pace = Pace(title)
        self.display = display
        self.next = time.monotonic() + FIRST_SECONDS
        self.handle: Any = None

    def __call__(self, done: float, text: str) -> None:
        sentence = self.pace(done, text)
        if time.monotonic() < self.next:
            return
        self.next = time.monotonic() + NEXT_SECONDS
        page = f'<progress max="1" value="{done:.3f}"></progress> {html.escape(sentence)}'
        self._show({"text/html": page, "text/plain": sentence})

    def clear(self) -> None:
        """Remove the bar, so that the saved notebook does not hold it."""
        if self.handle:
            self._show({"text/html": "", "text/plain": ""})

    def _show(self, forms: dict[str, str]) -> None:
        if self.handle:
            self.handle.update(forms, raw=True)
        else:
            self.handle = self.display(forms, raw=True, display_id=True)


# ------------------------------------------------------------------------------
# Deadlines: when a calculation with a budget must end.
#
# Ctrl-C acts like a deadline that passes: a calculation under way ends with the results that it
# has.
# ------------------------------------------------------------------------------


Found = TypeVar("Found")

_asked_for: ContextVar[float | None] = ContextVar("asked_for", default=None)
"""Budget that a user asked for, s, which messages name while a calculation gets a part of it; None
while the calculation gets all of it."""

SHORTEST_BUDGET = 1e-3
"""Budget of a calculation that begins after its deadline, s: a budget must be positive."""

_heard = [0]
"""Number of times that Ctrl-C has ended calculations in this process, as the only entry."""

_late = [0]
"""Number of times that the clock of this process found a deadline over, or one cut a calculation
short. It is the only entry."""

_heeded_from: list[int] = []
"""Value of `_heard` when `graceful_interrupt` was entered, as the only entry; empty outside it."""


OVERDUE_SHARE, OVERDUE_SECONDS = 0.15, 1.2
"""Time after the deadline, or after Ctrl-C, at which a calculation that has not ended by itself is
ended by an exception: this share of its budget, and these seconds. A command ends within 2 s after
1.2 budgets, and within 2 s after Ctrl-C."""

LOOK_SECONDS = 0.05
"""Seconds between two looks at the clock while a calculation is watched."""

_stood_still = [0.0]
"""Seconds for which the clock of all deadlines stood still in this process, as the only entry."""

_stands_still_since: list[float] = []
"""Times (`time.time()`, s) at which the clock was stopped and not yet started again, outermost
first."""


def stood_still() -> float:
    """Time for which the clock of all deadlines has stood still, s. It stands still while kernels
    are compiled, which does not count against a budget."""
    return _stood_still[0] + sum(time.time() - since for since in _stands_still_since[:1])


def stop_clock() -> None:
    """Stop the clock of all deadlines. It goes on after as many calls of `start_clock`."""
    _stands_still_since.append(time.time())


def start_clock() -> None:
    """Undo one call of `stop_clock`."""
    since = _stands_still_since.pop()
    if not _stands_still_since:
        _stood_still[0] += time.time() - since


def clock_decides() -> None:
    """Count that the clock ends a calculation or leaves out a part of it: another run, on a faster
    or slower machine, may then have other digits."""
    _late[0] += 1


def decisions_of_the_clock() -> int:
    """How often the clock has decided in this process."""
    return _late[0]


class Overdue(KeyboardInterrupt):
    """Ends a calculation that has not ended by itself after its deadline, as a second Ctrl-C."""


@dataclass(frozen=True)
class Deadline:
    """The moment at which an answer is due.

    Parameters
    ----------
    moment
        Moment on the clock `time.time()`, s, which workers on other machines share. Infinite for
        no limit.
    budget
        Budget that messages name, s (see `asked_for`); None for no limit.
    before
        Number of times that Ctrl-C had been heard when the deadline was made; at the next one the
        deadline passes. Infinite where Ctrl-C is not heard.
    stood
        Seconds for which the clock had stood still when the deadline was made. It is `due` later
        by the seconds for which the clock has stood still since then.

    Examples
    --------
    >>> Deadline.after(None).passed(), Deadline.after(60.0).passed(), Deadline.after(0.0).passed()
    (False, False, True)
    """

    moment: float = math.inf
    budget: float | None = None
    before: float = math.inf
    stood: float = field(default_factory=stood_still, compare=False)

    def __reduce__(self) -> tuple[type[Deadline], tuple[float, float | None, float]]:
        # another process counts the seconds for which its own clock stood still
        return Deadline, (self.due, self.budget, self.before)

    @classmethod
    def after(cls, budget: float | None) -> Deadline:
        """The deadline `budget` seconds from now; None for no limit.

        Within `graceful_interrupt`, a Ctrl-C that came earlier makes the new deadline pass as well.
        """
        before = _heeded_from[0] if _heeded_from else _heard[0]
        if budget is None:
            return cls(math.inf, None, before)
        return cls(time.time() + budget, _asked_for.get() or budget, before)

    @property
    def due(self) -> float:
        """The moment, later by the seconds for which the clock has stood still meanwhile."""
        return self.moment + (stood_still() - self.stood)

    def passed(self) -> bool:
        """Whether the moment is over, or Ctrl-C was heard."""
        if self.interrupted:
            return True
        late = time.time() >= self.due
        if late:
            clock_decides()
        return late

    def passed_by(self, seconds: float) -> bool:
        """Whether the moment is over for so many seconds, or Ctrl-C was heard."""
        return self.interrupted or time.time() >= self.due + seconds

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C was heard since the deadline was made (see `graceful_interrupt`)."""
        return _heard[0] > self.before

    @property
    def left(self) -> float:
        """Seconds until the deadline: infinite without a limit, 0 once it has passed."""
        return 0.0 if self.passed() else max(self.due - time.time(), 0.0)

    @property
    def rest(self) -> float | None:
        """The seconds that are left, as the `budget` of a calculation that begins now."""
        return None if math.isinf(self.left) else max(self.left, SHORTEST_BUDGET)

    def sooner(self, share: float) -> Deadline:
        """An earlier deadline, which leaves a share (0 to 1) of the remaining seconds unused."""
        if math.isinf(self.moment):
            return self
        return replace(self, moment=self.moment - share * self.left)

    def sooner_by(self, seconds: float) -> Deadline:
        """The deadline so many seconds before this one."""
        return replace(self, moment=self.moment - seconds)

    def in_no_less_than(self, seconds: float) -> Deadline:
        """The later one of this deadline and the moment so many seconds from now."""
        moment = max(self.due, time.time() + seconds)
        return replace(self, moment=moment, stood=stood_still())

    def share(self, share: float) -> Deadline:
        """The deadline of one of several calculations, after a share (0 to 1) of the remaining
        seconds."""
        return self.sooner(1.0 - share)

    def part(self, share: float) -> float | None:
        """A share (0 to 1) of the remaining seconds, as the `budget` of one of several
        calculations; None for no limit."""
        return None if self.rest is None else max(share * self.rest, SHORTEST_BUDGET)

    def fell_short(self, where: str, remedy: str, answer: Any = None) -> NotConverged | Interrupted:
        """The error to raise if the deadline passed before an answer was as accurate as asked for.

        Its message is "the budget of 5 s ended `where`; `remedy`", and it carries the answer up to
        that moment. After Ctrl-C the error is `Interrupted`, and the answer is marked so.
        """
        if self.interrupted:
            if is_dataclass(answer) and hasattr(answer, "interrupted"):
                answer = replace(answer, interrupted=True)  # type: ignore[type-var]
            return Interrupted(f"interrupted by Ctrl-C {where}", answer)
        # rounded, because a share of a budget may have many digits
        budget = float(f"{self.budget or 0.0:.3g}")
        return NotConverged(f"the budget of {budget:g} s ended {where}; {remedy}", answer)

    def ended_by_exception(
        self, reason: KeyboardInterrupt, where: str, answer: Any = None
    ) -> NotConverged | Interrupted:
        """The error to raise in place of a KeyboardInterrupt: that of the budget for `Overdue`.

        After any other one all deadlines of the calculation pass, as if it had been heard.
        """
        if isinstance(reason, Overdue):
            return self.fell_short(where, "raise budget", answer)
        _heard[0] += 1
        return Interrupted(f"interrupted by Ctrl-C {where}", answer)


def partial_result(calculate: Callable[..., Found], *arguments: Any, **named: Any) -> Found:
    """The answer of a calculation, or its answer so far if its budget or Ctrl-C ended it.

    It is for a calculation that is part of another one, which judges the errors of the partial
    answer and watches its own deadline.
    """
    try:
        return calculate(*arguments, **named)
    except (NotConverged, Interrupted) as reason:
        if reason.partial is None:
            raise
        found: Found = reason.partial
        return found


NEVER = Deadline()
"""The deadline of a calculation that may take as long as it needs and ignores Ctrl-C."""


@contextmanager
def asked_for(budget: float | None) -> Iterator[None]:
    """Let messages name this budget for all deadlines that are made within the `with` block.

    Such deadlines may have only a part of the budget. The outermost of nested blocks counts.

    >>> with asked_for(60.0):
    ...     str(Deadline.after(17.3).fell_short("on the way", "raise budget"))
    'the budget of 60 s ended on the way; raise budget'
    """
    before = _asked_for.set(_asked_for.get() or budget)
    try:
        yield
    finally:
        _asked_for.reset(before)


@contextmanager
def graceful_interrupt() -> Iterator[None]:
    """Let the first Ctrl-C within the `with` block make all deadlines pass.

    Only a second Ctrl-C raises KeyboardInterrupt. Nothing changes outside the main thread, in a
    program with its own handler of SIGINT, or within another block of this kind.
    """
    usual = signal.default_int_handler
    main = threading.current_thread() is threading.main_thread()
    if not main or _heeded_from or signal.getsignal(signal.SIGINT) is not usual:
        yield
        return

    def hear(*_: Any) -> None:
        if _raise_overdue:
            _raise_overdue.clear()
            raise_here(Overdue)
            return
        _heard[0] += 1
        signal.signal(signal.SIGINT, hear_again)

    def hear_again(*_: Any) -> None:
        raise_here(KeyboardInterrupt)

    def raise_here(error: type[KeyboardInterrupt]) -> None:
        if not raise_late(threading.get_ident(), error):
            raise error

    _heeded_from.append(_heard[0])
    signal.signal(signal.SIGINT, hear)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
        _heeded_from.clear()
        _raise_overdue.clear()


def ctrl_c_was_heard() -> bool:
    """Whether Ctrl-C was heard in the `graceful_interrupt` block that is entered now."""
    return bool(_heeded_from) and _heard[0] > _heeded_from[0]


_raise_overdue: list[bool] = []
"""Not empty while the next SIGINT of the main thread means `Overdue`, and no Ctrl-C."""

_watched = threading.local()
"""Number of blocks of `ended_by` in which a thread is, as `blocks`."""


def watched() -> bool:
    """Whether this thread is within a block of `ended_by`."""
    return getattr(_watched, "blocks", 0) > 0


@contextmanager
def ended_by(budget: float | None, patience: float = OVERDUE_SECONDS) -> Iterator[None]:
    """End the calculation within the `with` block once its budget, or Ctrl-C, is long over.

    A calculation looks at its own deadline, and ends with what it has. Where one of its steps takes
    longer than was thought, `Overdue` is raised in it between two instructions of Python, and again
    while it goes on. It becomes the error of the deadline, with the answer so far if there is one.

    `patience` is the time after the deadline, s, for which a calculation may go on.
    """
    with graceful_interrupt(), _silent_where_it_is_ignored():
        deadline, ended, fired = Deadline.after(budget), threading.Event(), threading.Event()
        thread, lock = threading.get_ident(), threading.Lock()

        def watch() -> None:
            end: Deadline | None = None
            while not ended.wait(LOOK_SECONDS):
                if end is None and deadline.passed():
                    share = 0.0 if deadline.interrupted else OVERDUE_SHARE * (budget or 0.0)
                    end = Deadline(time.time() + patience + share)
                if end is not None and end.passed():
                    with lock:
                        if not ended.is_set():
                            fired.set()
                            _raise_in(thread)
                    end = Deadline(time.time() + OVERDUE_SECONDS)

        def close() -> None:
            while True:
                try:
                    with lock:
                        ended.set()
                    watched()  # what was raised before arrives in this call at the latest
                    return
                except KeyboardInterrupt:
                    continue

        _watched.blocks = getattr(_watched, "blocks", 0) + 1
        threading.Thread(target=watch, daemon=True).start()
        try:
            try:
                yield
            finally:
                _watched.blocks -= 1
                close()
        except (KeyboardInterrupt, SystemError) as error:
            close()
            # Python makes a SystemError of what is raised while code of other libraries returns
            reason = error.__cause__ if isinstance(error, SystemError) else error
            if not fired.is_set() or not isinstance(reason, KeyboardInterrupt):
                raise
            answer = getattr(reason, "partial", None)
            if hasattr(answer, "interrupted") and is_dataclass(answer):
                answer = replace(answer, interrupted=False)  # type: ignore[type-var]
            where = "before there was an answer" if answer is None else "on the way"
            raise deadline.fell_short(where, "raise budget", answer) from None


_command: ContextVar[Deadline | None] = ContextVar("command", default=None)
"""Deadline of the command that is under way; None outside commands."""


@contextmanager
def of_command(deadline: Deadline) -> Iterator[None]:
    """Let what is read within the `with` block mind the deadline of a command (`in_command`)."""
    before = _command.set(deadline)
    try:
        yield
    finally:
        _command.reset(before)


@contextmanager
def in_command() -> Iterator[None]:
    """End the `with` block as `ended_by` does once the budget of the command, or Ctrl-C, is long
    over. Nothing changes outside commands, and within a calculation that is ended so anyway."""
    deadline = _command.get()
    if deadline is None or watched():
        yield
        return
    with asked_for(deadline.budget), ended_by(deadline.rest, OVERDUE_SECONDS):
        yield


@contextmanager
def _silent_where_it_is_ignored() -> Iterator[None]:
    """Print nothing of an `Overdue` that comes in a destructor, where Python cannot raise it."""
    usual = sys.unraisablehook

    def tell(what: sys.UnraisableHookArgs) -> None:
        if not isinstance(what.exc_value, Overdue):
            usual(what)

    sys.unraisablehook = tell
    try:
        yield
    finally:
        if sys.unraisablehook is tell:
            sys.unraisablehook = usual


def _raise_in(thread: int) -> None:
    """Raise `Overdue` in a thread, whose locks are not waited for where it is the main thread."""
    main = threading.main_thread().ident
    if thread == main and _heeded_from and hasattr(signal, "pthread_kill"):
        _raise_overdue[:] = [True]
        signal.pthread_kill(thread, signal.SIGINT)
    else:
        import ctypes

        if raise_late(thread, Overdue):
            return
        raise_at = ctypes.pythonapi.PyThreadState_SetAsyncExc
        raise_at(ctypes.c_ulong(thread), ctypes.py_object(Overdue))
