"""The live page: its server, its protocol and its files."""
