"""The live page: its server, its protocol, and the browser's part in `web`.

The node that feeds it is in `nodes.view`.
"""
