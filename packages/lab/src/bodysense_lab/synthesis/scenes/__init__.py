"""Scripted scenes of people at home, whose feet, steps and postures are true by construction."""

from bodysense_lab.synthesis.scenes.sequence import KINDS, ScriptedScene, sequence

__all__ = ["KINDS", "ScriptedScene", "sequence"]
