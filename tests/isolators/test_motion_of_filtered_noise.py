"""The page of a sizing under filtered noise, whose records name the oscillator of each column."""

from stochvi import load_scene, size
from stochvi.isolators.sizing.motion import motion_between_stops
from stochvi.scenes.datasets import zoo_files


def test_the_motion_under_filtered_noise_is_described() -> None:
    scene = load_scene(zoo_files()["filtered-lossy"])
    sizing = size(scene, rate=0.1, mission=60.0, budget=2.0, rel_error=0.3, threads=1)
    assert motion_between_stops(sizing).hits > 0  # it ended in a KeyError
