"""A folder to begin with: a vehicle file, blocks of one's own that run as they are, and a notebook."""

from baqueano.project.folder import new
