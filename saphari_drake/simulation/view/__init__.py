"""Figures and replays."""
