"""The numbers of the diagnosis that decide, in one table.

Each is a level of evidence, a limit of what a record can show, or an amount of work; none is
tied to an effect or a record.  A name that begins with MIN or MAX is a lower or an upper bound.
"""

from dryfric_control.estimation.likelihood import ASSUMPTION_COST
from dryfric_control.estimation.scoring import REMAINING_GAIN_RATIO as REMAINING_GAIN_RATIO

# Screening of all effects beside a model.
# Random force at which effects are screened, over the RMS drive: bounds.
MIN_SCREENING_FORCE = 0.03
MAX_SCREENING_FORCE = 0.3
# Factors of that random force at which shapes with a memory are tried.
SCREENING_FORCE_FACTORS = (1.0, 0.1)
# Iterations for the size of all noises in one pass.
NOISE_SCALE_ITERATIONS = 12

# Proposals.
# Number of periods of what repeats that a record holds: what does not come back within it is not
# known to come back.
MIN_PERIODS = 1.25
# Predicted gain of log-likelihood, beyond the logarithm of the number of shapes, from which an
# effect is proposed.
MIN_PREDICTED_GAIN = 6.0
# Number of single effects that are proposed.
MAX_SINGLE_PROPOSALS = 6
# Number of effects that one proposal joins.
MAX_JOINED_CAUSES = 3
# Number of other shapes of an effect that are tried.
MAX_OTHER_SHAPES = 3
# Predicted gain of log-likelihood from which one effect replaces another in a proposal.
MIN_EXCHANGE_GAIN = 2.0
# Part of a column outside the span of others up to which it does the same, and of an amount by
# which it may differ between the halves of a record.
MAX_SAME_RESIDUAL = 0.3
# Ratio up to which one counts as nothing beside the other: the force that another effect leaves and
# that of an effect; a random force in which no cause is left to find and the Coulomb level; a cause
# and the drive; the error that is left and that of the nominal axis.
NEGLIGIBLE_RATIO = 1e-3
# Factors of the parameters of a shape with a memory: steps of the coarse grid, which is searched
# at a large random force.
GRID_FACTORS = ((0.3, 0.5, 0.7, 1.4, 2.0, 3.0), (0.85, 1.2))
# The same where a first fit ends, as finely as the ridges of the likelihood are wide.
FINE_GRID_FACTORS = tuple(1.12**k for k in range(-18, 19) if k)

# Successive reversals of a record in which the fit of a shape with a memory finds where to begin.
SEARCH_REVERSALS = 6

# Full fits.
# Difference of costs within which a proposal is fitted on, or a start counts as likely.
FIT_SLACK = 8.0
# What a fit may still gain below which it decides nothing: a quarter of EQUAL_EVIDENCE.
MIN_DECIDING_GAIN = 1.0
# Predicted fall of the cost below which a fit ends.
CONVERGED_GAIN = 0.05

# Evidence.
# Log-likelihood that a cause must bring.
MIN_EVIDENCE = ASSUMPTION_COST
# Difference of log-likelihood below which two models are equal.
EQUAL_EVIDENCE = 4.0
# Number of causes.
MAX_CAUSES = 5
# Number of causes, those with least evidence, that may be exchanged.
MAX_EXCHANGED_CAUSES = 2
# Change of a base parameter's logarithm from which effects are screened at its nominal value, too.
MIN_BASE_CHANGE = 0.1

# Verdict.
# Windows of each record that are replayed.
MAX_REPLAYED_WINDOWS = 40
# Replays, enough that a window in which the axis breaks away only sometimes does so in one.
REPLAY_COUNT = 20
# Fraction of the windows that may have larger errors than all replays.
MAX_OUTLIER_FRACTION = 0.1
# Mean score above that of the replays up to which nothing is left.
MAX_EXCESS_SCORE = 0.2
# Force residual of an imposed motion over its part that changes from sample to sample, up to which
# it is noise.
MAX_WHITE_RESIDUAL_RATIO = 1.5
# Error of free runs over that of the nominal axis beyond which no cause is shown.
MAX_ERROR_RATIO = 1.1
# Random force over the Coulomb level beyond which nothing is explained.
MAX_RANDOM_FORCE_RATIO = 0.2
# RMS error of free runs, net of noise, over that of the nominal axis, beyond which a set of causes
# is not reported: it explains less than half of the squared error.
MAX_UNEXPLAINED_FRACTION = 0.7

# Base parameters.
# Relative error up to which one counts as right.
MAX_RIGHT_ERROR = 0.004
# Standard errors from which an error, a lead or a difference is certain.
MIN_STANDARD_ERRORS = 3.0
# RMS force of an error over the random force from which it is named.
MIN_FORCE_TO_NOISE_RATIO = 0.25

# View of the motion or of the force.
# Log-likelihood a sample by which a straight line must beat the base fit.
MIN_LINE_LEAD = 0.1
# Log-likelihood a sample by which a model must beat a straight line.
MIN_MODEL_LEAD = 0.2
# Random force over the drive below which the drive follows an imposed motion.
MAX_IMPOSED_FORCE_RATIO = 0.25

# Inputs.
# Half widths, in standard errors, of the intervals with which noise is taken off; 0: none.
INPUT_NOISE_WIDTHS = (0.0, 0.8, 1.0, 1.25)
# Lag-one correlation of what is taken off, up to which it is white.
MAX_LAG_ONE_CORRELATION = 0.1
# RMS of what is taken off over the random force, from which it makes a difference.
MIN_INPUT_NOISE_RATIO = 0.1
# Leads of the input over the time stamps that are tried [samples].
INPUT_LEADS = (0.5, 1.0, 2.0, 4.0, 8.0)
# Time, over the sampling time, from which it counts as a delay, a lag or a lead of the drive;
# anything else that is over within a sample has no visible course.
MIN_VISIBLE_DELAY = 0.02

# Free runs.
# Usual length [s].
FREE_RUN_LENGTH = 0.25
# Number of windows of a record.
MIN_WINDOWS = 10
# Fall of the mean score of unseen free runs, log(1 + cost/(4 n)), from which a cause shows in them.
MIN_SCORE_FALL = 0.03
# The same over its standard error.
MIN_SCORE_FALL_ERRORS = 2.0
# Evidence above which the force alone shows a cause.
STRONG_EVIDENCE = 60.0
# The same over the evidence for the strongest cause.
STRONG_EVIDENCE_FRACTION = 0.2

# Answer.
# Fraction of a time limit that is kept for the answer.
ANSWER_TIME_FRACTION = 0.3
# Number of alternatives for which an experiment is sought.
MAX_EXPERIMENT_ALTERNATIVES = 4
