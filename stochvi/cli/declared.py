"""Commands that are declared: the page of a command states its options, and a command is its
calculation."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

import click

from stochvi.cli.options import (
    Common,
    common,
    fail_unless_gaussian,
    judged_phase,
    on_page,
    shown,
)
from stochvi.cli.program import FAILED, main, stop
from stochvi.notices import InputWarning

if TYPE_CHECKING:
    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.scenes.scene import Scene

SAMPLING = ("seed", "threads")
"""Common options that go on to a calculation, beside the budget."""

Command = Callable[..., None]
Show = Callable[[Any], None]


@dataclass
class Question:
    """What a declared command asks: a scene, and the arguments of the calculation."""

    options: Common
    file: str
    """The scene file, with the name of a phase where one is asked for."""
    scene: Scene
    asked: dict[str, Any]
    """The options of the command, which become the arguments of the calculation."""
    of: str
    """The calculation, as "room:name"."""
    shares: str
    """The common options; those of `SAMPLING` go on to the calculation."""
    progress: str
    """Title of the progress; empty for a calculation that tells none."""
    judged: bool
    """Whether the answer takes a record of the scene for Gaussian noise."""
    unmet: list[str] = field(default_factory=list)
    """Why the answer ends in exit code 1."""
    whole: bool = False
    """Whether the calculation came to its end."""

    @cached_property
    def verdict(self) -> tuple[RecordVerdict | None, str]:
        """The verdict on the record of the scene where it is judged, and its phase."""
        return judged_phase(self.scene) if self.judged else (None, "")

    def show(self, answer: Any, beside: Callable[[], dict[str, Any]] = dict, **how: Any) -> None:
        """Show an answer, after the verdict on the record of the scene, and write its page if it
        has one, with what stands `beside` it there."""
        from stochvi.views.pictures import view_of, write_report

        self.options.show(answer, self.scene, verdict=self.verdict, **how)
        if view_of(answer).page and self.options.out is not None:
            origin = self.options.origin(self.file, answer.provenance)
            write_report(answer, self.options.out, origin, **beside())

    def asks(self, of: str, progress: str, asked: dict[str, Any]) -> None:
        """Ask another calculation."""
        self.of, self.progress, self.asked = of, progress, asked

    def answer(self) -> Any:
        """The answer of the calculation."""
        room, _, name = self.of.partition(":")
        ask = getattr(import_module(f"stochvi.{room}"), name)
        work = {key: getattr(self.options, key) for key in SAMPLING if key in self.shares}
        with contextlib.ExitStack() as stack:
            if self.progress:
                work["progress"] = stack.enter_context(self.options.progress(self.progress))
            found = ask(self.scene, **work, **{"budget": self.options.rest, **self.asked})
        self.whole = True
        return found


def command(shares: str, reads: str = "scene", name: str | None = None) -> Any:
    """Make a command of a function, whose docstring is its page.

    `shares` are its common options, and `reads` is its argument.
    """

    def decorate(function: Command) -> Command:
        if function.__doc__ is None:
            raise ImportError("commands need their docstrings; start Python without -OO")
        words, options = on_page(function.__doc__)
        run = common(*shares.split(", "))(function)
        for option in reversed(options):
            run = option(run)
        if reads:
            run = click.argument(reads)(run)
        main.command(name or function.__name__, help=words)(run)
        return function

    return decorate


def declare(
    of: str, shares: str, *, progress: str = "", judged: bool = False,
    fails: Callable[[Any], str] = lambda answer: "", name: str | None = None,
) -> Any:  # fmt: skip
    """Declare a command by its calculation, "room:name", which is imported when it is asked.

    The function below has the page of the command for its docstring. It changes the arguments of
    the calculation where they are not the options. It may return what shows the answer, in the
    place of `Question.show`.

    Parameters
    ----------
    shares
        Its common options; those of `SAMPLING` and the budget go on to the calculation.
    progress
        Title of its progress; empty for a calculation that tells none.
    judged
        Whether the answer takes a record of the scene for Gaussian noise.
    fails
        Why an answer ends in exit code 1; empty where it does not.
    """

    def decorate(own: Callable[[Question], Show | None]) -> Command:
        def run(options: Common, scene: str, **asked: Any) -> None:
            from stochvi.scenes.scene import load_scene

            loaded = load_scene(scene)
            for told in loaded.slipped_units():  # before anything takes its time
                warnings.warn(told, InputWarning, stacklevel=2)
                options.said.append(told)
            question = Question(options, scene, loaded, dict(asked), of, shares, progress, judged)
            show = own(question) or question.show
            carried: list[RecordVerdict | None] = []

            def tell(answer: Any) -> None:
                show(answer)
                carried.append(getattr(answer, "record", None))
                question.unmet.extend(filter(None, [fails(answer)]))

            shown(question.answer, tell, asked)
            for record in carried:
                fail_unless_gaussian(record)
            if question.unmet:
                stop(question.unmet[0], FAILED)

        run.__doc__ = own.__doc__
        run.__name__ = own.__name__
        return command(shares, name=name)(run)  # type: ignore[no-any-return]

    return decorate
