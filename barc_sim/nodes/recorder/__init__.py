"""The node `bag_recorder`."""
