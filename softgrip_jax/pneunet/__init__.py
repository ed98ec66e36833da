"""The pneu-net finger: chambers, cover, and the scenes of a finger and of a gripper of n fingers."""

from .finger import PneuNet as PneuNet
