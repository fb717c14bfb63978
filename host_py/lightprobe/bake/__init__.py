"""How light falls on a mesh that shades itself: prepared once, then lit by each packet."""

from lightprobe.bake.bake import Bake

__all__ = ["Bake"]
