"""The search for gains over thousands of closed loops.

Its figures are in `figures`.
"""
