"""What several studies run: true solutions of any scene, ladders of steps, verdicts on them."""
