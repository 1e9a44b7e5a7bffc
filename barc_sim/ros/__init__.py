"""Extensions of rclpy: executor, endpoints, conversions, names, parameters, processes, the graph.

No other package uses private parts of rclpy; the nodes themselves are in `nodes`.
"""
