"""Sequences as the thesis means them: build, deploy, run, collect, compare, clean up."""
