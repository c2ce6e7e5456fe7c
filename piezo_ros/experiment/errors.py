"""Errors of plans and campaigns."""

__all__ = ['CampaignError', 'PlanError']


class PlanError(ValueError):
    """A plan that cannot be run; the text names the file, the run, the key and its value."""


class CampaignError(RuntimeError):
    """A run that did not come to its end; the text says what happened and what is left."""
