"""What is told: findings, their numbers, regions, figures and doubts."""
