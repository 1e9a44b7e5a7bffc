"""Every Matplotlib figure, animation and video.

It draws values; it reads no bag and drives no car.
"""
