"""Judging the paper with the method: measures, claims, studies, figures and documents."""
