"""Scenes that differ by one effect each; the oscillator has omega = 1, zeta = 0.05, theta = 1."""

import stochvi as sv
from stochvi.scenes.datasets import shipped_scene

PLAIN = sv.Oscillator(mass=1.0, damping=0.1, stiffness=1.0)
WHITE, STEP = sv.WhiteNoise(intensity=0.2), 0.8
ABSORBER = sv.load_scene(shipped_scene("absorber-in-a-box"))
COLOURED = sv.FilteredNoise(intensity=0.2, frequency_hz=0.2, zeta=0.05)
TABLE = sv.TabulatedNoise(frequency_hz=[0.05, 0.5], density=[0.4, 0.4], unit="N2/Hz")
LAW, SOFT = sv.Restitution(coefficient=1.0), sv.Elastic(stiffness=100.0)


def scene(*excitations, law=None, **stops):
    pairs = [sv.ImpactPair(law=law, **stops)] if stops else []
    return sv.Scene(structure=PLAIN, impact_pairs=pairs, excitations=excitations)


SCENES = {
    "white noise": scene(WHITE),
    "+ constant load": scene(WHITE, sv.ConstantLoad(force=0.3)),
    "+ one rigid stop, R = 1": scene(WHITE, law=LAW, upper=1.0),
    "+ two rigid stops, R = 1": scene(WHITE, law=LAW, lower=-1.0, upper=1.0),
    "+ two rigid stops, R = 0.8": scene(
        WHITE, law=sv.Restitution(coefficient=0.8), lower=-1.0, upper=1.0
    ),
    "+ two elastic stops, 100 k": scene(WHITE, law=SOFT, lower=-1.0, upper=1.0),
    "white noise and sine": scene(WHITE, sv.Sine(amplitude=0.3, frequency_hz=0.14)),
    "filtered noise": scene(COLOURED),
    "filtered noise + two stops, R = 1": scene(COLOURED, law=LAW, lower=-1.0, upper=1.0),
    "table": scene(TABLE),
    "table + two stops, R = 1": scene(TABLE, law=LAW, lower=-1.0, upper=1.0),
    "absorber, two masses, R = 0.8": ABSORBER,
}
