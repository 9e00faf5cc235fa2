"""Reproduce the paper's case studies: its errors and the errors of baqueano, its two models, and a page about them."""
