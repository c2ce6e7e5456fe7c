"""Scores, tables, figures and the HTML report of runs; nothing here draws until it is asked to."""

from piezo_ros.report.metrics import Nonlinearity, nonlinearity, nrmse
from piezo_ros.report.score import ScoredRun, score

__all__ = ['Nonlinearity', 'ScoredRun', 'nonlinearity', 'nrmse', 'score']
