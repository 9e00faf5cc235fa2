"""Make a project folder: a vehicle file, own blocks that run without changes, and a notebook."""

from baqueano.project.folder import new
