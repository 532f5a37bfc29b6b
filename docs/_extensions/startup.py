"""What every notebook of the manual starts with: commands print whole lines, and may not fail."""

import os
import subprocess

from IPython.core.magic import register_cell_magic

os.environ.pop("FORCE_COLOR", None)  # the kernel asks for colours, which a page does not show


@register_cell_magic
def sh(line: str, cell: str) -> None:
    """Run commands; one that fails ends the build."""
    environment = os.environ | {"MPLBACKEND": "agg"}
    done = subprocess.run(
        ["sh", "-ec", cell], check=True, stdout=subprocess.PIPE, text=True, env=environment
    )
    print(done.stdout, end="")
