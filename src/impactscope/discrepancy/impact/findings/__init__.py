"""What is told: findings, their numbers and figures."""
