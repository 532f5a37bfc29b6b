"""What every notebook of the manual starts with: commands print whole lines, and may not fail."""

import html
import os
import subprocess
from pathlib import Path

from IPython.core.magic import register_cell_magic
from IPython.display import HTML, Image

os.environ.pop("FORCE_COLOR", None)  # the kernel asks for colours, which a page does not show


@register_cell_magic
def sh(line: str, cell: str) -> None:
    """Run commands; one that fails ends the build."""
    done = run(cell)
    done.check_returncode()
    print(done.stdout, end="")


def run(commands: str) -> subprocess.CompletedProcess[str]:
    """Run commands, and keep what they print."""
    environment = os.environ | {"MPLBACKEND": "agg"}
    return subprocess.run(
        ["sh", "-ec", commands], check=False, stdout=subprocess.PIPE, text=True, env=environment
    )


def picture(commands: str, file: str, alt: str) -> Image:
    """The picture that commands leave in a file; `alt` says it in words. A picture that is not
    there ends the build; an answer that falls short, as on a busy machine, does not."""
    run(commands)
    return Image(file, alt=alt, width="100%")


def framed(page: str, title: str) -> HTML:
    """A page of HTML that commands have left, within the page of the manual."""
    text = html.escape(Path(page).read_text(encoding="utf-8"))
    style = "width: 100%; height: 42em; border: 1px solid #8888; box-sizing: border-box"
    return HTML(f'<iframe title="{title}" srcdoc="{text}" style="{style}"></iframe>')
