"""The node `keyboard`."""
