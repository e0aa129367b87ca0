"""The numbers of the diagnosis that decide, in one table.

Each is a level of evidence, a limit of what a record can show, or an amount of work; none is
tied to an effect or a record.
"""

from dryfric_control.estimation.likelihood import ASSUMPTION

# Noises of the pass at which effects are screened: bounds of the random force over the RMS
# drive, factors of it at which what remembers is tried, and iterations for the size of all noises.
QUIETEST, LOUDEST, QUIET, SETTLED = 0.03, 0.3, (1.0, 0.1), 12
# Proposals: predicted gain beyond the logarithm of the number of shapes; number of single
# effects, of joined ones, of other shapes that are tried; gain by which an exchange must help.
CHANCE, PROPOSALS, JOINT, NEIGHBOURS, COINCIDE = 6.0, 6, 3, 3, 2.0
# Part of a column outside the span of others up to which it does the same, and of an amount by
# which it may differ between the halves of a record.
SAME = 0.3
# Part of a force that counts as nothing: of that of an effect, which another leaves that acts
# alike; of the friction, as a random force in which no cause is left to find.
SAME_FORCE = 1e-3
# Factors of the parameters of a shape with a memory that are tried: at a large random force, and
# where a first look ends, as finely as its ridges are wide.
WALKED = ((0.3, 0.5, 0.7, 1.4, 2.0, 3.0), (0.85, 1.2))
SCANNED = tuple(1.12**k for k in range(-18, 19) if k)
# Full fits: slack within which a proposal is fitted on, the ratio of what it may still gain to
# what its last step brought and promises, and the promise that ends a fit.
SLACK, AHEAD, ENOUGH = 8.0, 5.0, 0.05
# Evidence: log-likelihood that a cause must bring, and difference below which two are equal.
LEAST, EQUAL = ASSUMPTION, 4.0
# Largest number of causes, and of those with least evidence that may be exchanged.
MOST, EXCHANGED = 5, 2
# Change of a base parameter's logarithm from which effects are screened at its nominal value, too.
MOVED = 0.1
# Verdict: windows of each record that are replayed, and replays, enough that a window in which
# the axis breaks away only sometimes does so in some replay; fraction of the windows that may
# have larger errors than all replays, and excess of the mean score that is no structure; ratio
# of an imposed motion's force residual to its changes from sample to sample that is structure;
# error over that of the nominal axis beyond which no cause is shown; random force, over the
# Coulomb level, beyond which nothing is explained.
REPLAYED, REPLAYS, STRAY, EXCESS, SMOOTH, WORSE, MUTED = 40, 20, 0.1, 0.2, 1.5, 1.1, 0.2
# Base parameters: relative error up to which one counts as right, standard errors, and RMS force
# over the random force, from which it is named.
RIGHT, CLEAR, NOTABLE = 0.004, 3.0, 0.25
# View: log-likelihood a sample by which a straight line must beat the base fit, and a model the
# line, and random force over the drive up to which the drive follows an imposed motion.
BEHIND, CLEAR_OF, FOLLOWS = 0.1, 0.2, 0.25
# Inputs: widths with which noise is taken off, largest lag-one correlation of what is taken off,
# least size of it over the random force, and leads over the time stamps that are tried [samples].
WIDTHS, WHITE, HEARD = (0.0, 0.8, 1.0, 1.25), 0.1, 0.1
EARLIER = (0.5, 1.0, 2.0, 4.0, 8.0)
# Free runs: usual length [s], and fewest of a record.
WINDOW, LEAST_WINDOWS = 0.25, 10
# Fraction of a time limit that is kept for the answer, and largest number of alternatives for
# which an experiment is sought.
ANSWER, RIVALS = 0.3, 4
# Shortest time, over the sampling time, that counts as a delay, a lag or a lead of the drive;
# anything else that is over within a sample has no visible course.
SOONEST = 0.02
# Fall of the mean score of unseen free runs, log(1 + cost/(4 n)), that a cause must bring: in
# itself, and over its standard error; evidence above which the force alone shows it, in itself
# and over that of the strongest cause.
FREE, NOTED, STRONG, OUTSTANDING = 0.03, 2.0, 60.0, 0.2
# Part of the RMS error of free runs, net of noise, beyond which a set of causes is not reported: it
# explains less than half of the squared error.
MOST_LEFT = 0.7
