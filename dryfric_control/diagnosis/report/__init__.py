"""What a diagnosis shows: findings, words, figures, page."""
