"""What several tests share: scenes, known answers, twins, readers of answers."""

from pathlib import Path

CHECKOUT = Path(__file__).parents[2]
