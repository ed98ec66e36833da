"""Numerics that know no gripper: functions in, numbers out."""
