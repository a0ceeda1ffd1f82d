"""Scenes as functions of time, each declaring the effects it calls for."""
