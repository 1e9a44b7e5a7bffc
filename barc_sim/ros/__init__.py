"""Extensions of rclpy: executor, endpoints, conversions, names, parameters, processes, the graph.

No other room uses private parts of rclpy; the nodes themselves are in `nodes`.
"""
