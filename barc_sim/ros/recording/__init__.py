"""A recorder's subscriptions over DDS: discovery, raw messages, and what is lost or left out."""
