"""The five methods in one cell, under one supervisor."""
