"""Make a project folder: a vehicle file, example blocks that run without changes, and a notebook."""

from baqueano.project.folder import new
