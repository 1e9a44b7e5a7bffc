"""What rclpy lacks: the executor, endpoints, conversions, names, parameters, processes, the graph.

The only room that uses private parts of rclpy; no node lives here.
"""
