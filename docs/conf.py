"""How Sphinx builds the manual: `make docs`. Nothing is fetched, neither here nor by a reader."""

import os
import shutil
import sys
import tempfile
from importlib.metadata import version as version_of
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_extensions"))

# cells that call the command find the one of this environment, and write plain text of one width
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
os.environ |= {"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb"}
startup = Path(tempfile.mkdtemp()) / "profile_default" / "startup"
startup.mkdir(parents=True)
shutil.copy(HERE / "_extensions" / "startup.py", startup)
os.environ["IPYTHONDIR"] = str(startup.parents[1])

project = "stochvi"
author = "The stochvi developers"
copyright = author
version = release = version_of("stochvi")
language = "en-GB"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.intersphinx",
    "numpydoc",
    "sphinx_click",
    "sphinx_copybutton",
    "sphinxcontrib.bibtex",
    "sphinx_design",
    "mathml",
    "typed",
    "reference",
    "notebooks",
]
exclude_patterns = ["_build", "_extensions", "inventories", "pictures/make.py", "plugin"]
nitpicky = True
default_role = "code"

autodoc_typehints = "none"  # `typed` writes them as the source has them
python_maximum_signature_line_length = 88
# names in annotations that have no page here
nitpick_ignore_regex = [("py:class", r"[^.]+|(np|pd|collections|typing)\..*|.*[\[~].*")]
bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "unsrt"
bibtex_reference_style = "author_year"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # s; kernels may be compiled in a cell
nb_execution_in_temp = True
nb_merge_streams = True
nb_output_stderr = "remove"  # progress of commands

# inventories lie in the repository (`inventories/make.py`): a build fetches none
intersphinx_mapping = {
    name: (place, f"inventories/{name}.inv")
    for name, place in {
        "python": "https://docs.python.org/3",
        "numpy": "https://numpy.org/doc/stable",
        "pandas": "https://pandas.pydata.org/docs",
        "matplotlib": "https://matplotlib.org/stable",
    }.items()
}

smartquotes_action = "qe"  # options keep their two dashes

html_math_renderer = "mathml"
html_theme = "furo"
html_title = "stochvi"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
html_js_files = [("versions.js", {"defer": "defer"})]
html_copy_source = False
html_show_sourcelink = False
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True
copybutton_only_copy_prompt_lines = False
