"""Make the inventories by which links to other projects are found.

They hold the names that this manual links to, and no more; needs sphobjinv.
"""

from pathlib import Path

from sphobjinv import DataObjStr, Inventory, compress, writebytes

NAMES = {
    "python": [
        ("py", "class", "concurrent.futures.Executor", "library/concurrent.futures.html#$"),
        ("py", "class", "pathlib.Path", "library/pathlib.html#$"),
        ("py", "exception", "KeyboardInterrupt", "library/exceptions.html#$"),
        ("py", "module", "tomllib", "library/tomllib.html#module-$"),
    ],
    "numpy": [("py", "class", "numpy.ndarray", "reference/generated/numpy.ndarray.html#$")],
    "pandas": [
        ("py", "class", "pandas.DataFrame", "reference/api/pandas.DataFrame.html#$"),
    ],
    "matplotlib": [
        ("py", "class", "matplotlib.axes.Axes", "api/_as_gen/matplotlib.axes.Axes.html#$"),
    ],
}
"""Domain, role, name and place (`$` stands for the name) of each object, by project."""

for project, objects in NAMES.items():
    inventory = Inventory()
    inventory.project, inventory.version = project, ""
    for domain, role, name, place in objects:
        inventory.objects.append(
            DataObjStr(name=name, domain=domain, role=role, priority="1", uri=place, dispname="-")
        )
    path = Path(__file__).with_name(f"{project}.inv")
    writebytes(path, compress(inventory.data_file()))
