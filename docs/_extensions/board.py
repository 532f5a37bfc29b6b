"""Write the board with sixty gaps of `howto/structures.md`, `board.toml` and `gaps.csv`."""

from pathlib import Path

SCENE = """pairs = "gaps.csv"

[structure]
kind = "plate"
length = 0.25
width = 0.2
height = 0.0016
young = 22e9
density = 2400
zeta = 0.02
max_frequency_hz = 1000

[structure.points]
{points}
[[excitation]]
kind = "psd"
on = "base"
frequency_hz = [20, 80, 350, 2000]
density = [0.01, 0.04, 0.04, 0.007]
unit = "g2/Hz"
"""

places = {
    f"u{10 * row + column}": [0.1 + 0.2 * row, 0.05 + 0.1 * column]
    for row in range(5)
    for column in range(10)
}
points = "".join(f"{name} = {place}\n" for name, place in places.items())
Path("board.toml").write_text(SCENE.format(points=points), encoding="utf-8")

gaps = [
    f"{name} to the lid,{name},,{2.2 + 0.1 * (7 * number % 13):.1f},0.1"
    for number, name in enumerate(places)
]
gaps += [
    f"u{number} to u{number + 10},,u{number} u{number + 10},{1.2 + 0.1 * (number % 7):.1f},0.1"
    for number in range(10)
]
heading = "name,on,between,upper (mm),tolerance (mm)"
Path("gaps.csv").write_text("\n".join([heading, *gaps]) + "\n", encoding="utf-8")
