"""Trackers and hands for SteamVR by Virtual Motion Tracker."""
