"""A rough estimate, before it begins, of the cost of an experiment with a hosted model."""

from dataclasses import dataclass

from pliant.experiment.cells import Experiment
from pliant.reasoners.vlm.settings import Decider, Detail, Effort, Settings

# Measured with a scripted model that answers as the rules do (circle, all, seeds 1 to 8): 6.4
# requests a trial, 12,700 characters with the forms of the replies and 1.16 pictures each.
_VERDICTS, _RECOVERIES = 4.1, 1.1  # a trial
_WORDS = 3150  # tokens: characters / 4; what a cache makes cheaper is not taken off
_PICTURE = {Detail.LOW: 85, Detail.HIGH: 765}  # tokens of 640 x 480, as OpenAI counts them
_FIRST = 150  # tokens of the words of the request that is sent first, and the reply's schema
_REPLY = 250  # tokens: a guess, models differ in how much they say
_THOUGHTS = {None: 0, Effort.LOW: 500, Effort.MEDIUM: 2000, Effort.HIGH: 6000}  # tokens: a guess

_Use = tuple[float, float, float]
"""The number of requests, of tokens sent and of tokens received."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """An estimate of a hosted model's use and cost. `usd` None: the price of a model is not known.
    A weak model fails more and costs more."""

    trials: int
    requests: int
    tokens: int
    usd: float | None

    def __str__(self) -> str:
        cost = "at a price that is not known" if self.usd is None else f"about {self.usd:.2f} USD"
        return (
            f"{self.trials} trials ask a model about {self.requests} times,"
            f" {self.tokens / 1e6:.1f} million tokens, {cost}"
        )


def estimate(experiment: Experiment) -> Estimate | None:
    """Estimate the cost of all trials whose model is a hosted one; None: there are none."""
    asked = [c.vlm for c in experiment.cells if c.vlm is not None and c.vlm.is_hosted]
    if not asked:
        return None
    n = experiment.trials
    spent = [(settings, n, _trial(settings)) for settings in asked]
    spent += [(settings, 1, _first_request(settings)) for settings in dict.fromkeys(asked)]
    dollars = [_usd(settings, use) for settings, _, use in spent]
    known = [d for d in dollars if d is not None]
    return Estimate(
        trials=n * len(asked),
        requests=round(sum(times * requests for _, times, (requests, _, _) in spent)),
        tokens=round(sum(times * (sent + got) for _, times, (_, sent, got) in spent)),
        usd=sum(times * d for (_, times, _), d in zip(spent, known, strict=True))
        if len(known) == len(dollars)
        else None,
    )


def _trial(settings: Settings) -> _Use:
    """The use of one trial."""
    requests = 0.0
    if settings.judge is Decider.VLM:
        requests += _VERDICTS
    if settings.recover is Decider.VLM:
        requests += _RECOVERIES * ((1 if settings.one_call else 2) + settings.probes)
    pictures = (
        settings.picture * 1.0
        + settings.oblique_picture * 1.0
        + (settings.goal_picture and settings.judge is Decider.VLM) / 6
    )
    sent = requests * (_WORDS + pictures * _PICTURE[settings.detail])
    return requests, sent, requests * (_REPLY + _THOUGHTS[settings.effort])


def _first_request(settings: Settings) -> _Use:
    """The use of the request before the first trial."""
    return 1.0, _FIRST + settings.picture * _PICTURE[settings.detail], _REPLY / 10


def _usd(settings: Settings, use: _Use) -> float | None:
    price = settings.usd_per_million or _published(settings)
    _, sent, received = use
    return None if price is None else (price[0] * sent + price[1] * received) / 1e6


def _published(settings: Settings) -> tuple[float, float] | None:
    """The published price in USD of a million tokens sent and received, from the list that the
    model library brings."""
    from genai_prices import Usage, calc_price

    provider, _, name = (settings.model or "").partition(":")
    usage = Usage(input_tokens=1_000_000, output_tokens=1_000_000)
    try:
        found = calc_price(usage, name, provider_id=provider)
    except LookupError:
        return None
    return float(found.input_price), float(found.output_price)
