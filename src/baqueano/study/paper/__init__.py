"""The paper's case studies, reproduced: its errors and ours, its two models, and the page that shows them."""
