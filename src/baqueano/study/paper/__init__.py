"""The paper's case studies, reproduced: its errors and those of baqueano, its two models, and a page of them."""
