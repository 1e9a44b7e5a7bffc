"""What nodes share without ROS: topics, services, QoS, stamps, parameters, records of messages.

Nodes, bags, the page and the figures take the names from here; nothing here imports them.
"""
