"""Finds, builds and runs CmdStan: toolchain, installation, compiled programs."""
