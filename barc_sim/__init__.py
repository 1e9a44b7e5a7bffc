"""The BARC vehicle simulator for ROS 2: model, controller, recorder, plots and replays."""

__version__ = '0.1.0'
