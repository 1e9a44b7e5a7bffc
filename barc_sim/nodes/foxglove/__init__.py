"""The node `foxglove`: serves every topic to the Foxglove app."""
