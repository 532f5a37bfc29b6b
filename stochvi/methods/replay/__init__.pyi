from .answer import Replay, ReplayAt
from .method import replay

__all__ = ["Replay", "ReplayAt", "replay"]
