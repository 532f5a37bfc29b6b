from .recorded_motion import Replay, ReplayAt, replay

__all__ = ["Replay", "ReplayAt", "replay"]
