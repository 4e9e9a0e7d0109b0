"""Families of periodic orbits by name: labels, search, tracing, branches with their events, files and figures.

Nothing is loaded before it is used; `import saltus` offers what is public.
"""
