"""The numbers that decide which curve is found in a scan, and which of its parts are doubted, in one object.

What limits the work alone (sizes of arrays, iterations, neighbours) stands beside the code.

Symbols: r radius, L length of the cable, sigma noise of a point.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class ExtractionSettings:
    """Thresholds in the order of the chain; lengths are in r unless another unit is named."""

    # the cloud
    units: float = 50.0  # clouds this many times longer than the cable are in other units: no room is so large
    isolated: float = 5.0  # robust standard deviations of the logarithm of the distance to neighbours
    plane: int = 100  # fewest points of a table or wall
    filled: float = 0.45  # ratio of in-plane variances around a point of a plane: a noisy cable has 0.2, a table 1
    tube: float = 3.0  # half-width of the tube of points around a curve, wide enough for the errors of the coarse curve
    tube_of_length: float = 0.015  # of L, the same for thin cables; a shorter stretch without points is no gap either
    on: float = 3.0  # sigma: a point further from the surface is not on it, and a curve less certain than that a guess
    certain: float = 0.3  # smallest weight of a point on the cable
    few: int = 60  # points: a smaller cloud was picked by hand, and does not sample a surface
    missed: float = 2e-3  # of the points used: with more points of the cable outside the tube another round follows

    # guide points
    guides_longer: float = 1.08  # of L: marks on the outside of bends are slightly longer, a wrong order much longer
    guides_shorter: float = 0.85  # an exchange of marks that shortens their polyline so much shows a wrong order
    fold: float = -0.5  # cosine of a turn at a mark too sharp for a cable
    guided: float = 1.5  # distance within which a vote belongs to the curve through the marks

    # votes and strands
    thick: float = 0.3  # patches of points thicker than this have no normal
    blurred: float = 1.5  # sigma: apparent radius of a tube whose points have no normals
    thin: float = 0.2  # of the usual density of votes: less is debris
    lined_up: float = 0.7  # share of the variance of votes along their first axis: less is no curve
    turn_cost: float = 2.0  # a turn by one radian makes a step this much longer
    crumb: float = 1.5  # longest steps: shorter strands are debris, which joins may bridge
    facing: float = 0.1  # smallest cosine between a join and the direction of a strand at its end
    gap: float = 0.13  # of L: longest join (10 % and the thin edges of the cloud on both sides)
    wide_gap: float = 0.28  # of L: longest join if there is no other path; the length must then agree

    # trust in a coarse curve
    explained: float = 0.75  # smallest share of the votes that it explains
    explained_met: float = 0.35  # the same if length and clamps agree: the other votes are clutter
    coarse_length: float = 0.08  # of L: largest error of a length that cuts corners
    met_length: float = 0.02  # of L: largest error of a length that agrees
    met_direction: float = 0.8  # smallest cosine to the clamps' directions
    as_good: float = 0.15  # of badness: another curve within this margin makes the result ambiguous
    otherwise: float = 0.06  # of L: curves that differ less are one

    # the last stage
    narrowing: float = 0.7  # factor of the window of non-zero weight per iteration, from `tube` on
    tukey: float = 4.0  # sigma, beyond which a point has zero weight
    noisy: float = 0.25  # sigma above which a scan from one side is not reliable without viewpoints
    face_eye: float = 0.8  # share of the points that must face a viewpoint for the viewpoints to be those of the scan
    silhouette: float = 0.98  # rays that pass further out get the surface depth at this distance plus their excess
    stray: float = 1.3  # rays that pass further out miss the cable
    blur: float = 0.2  # noise across the ray over that along it
    converged: float = 0.03  # sigma: smaller moves of all points end the iteration
    still: float = 2e-3  # the same where the noise is smaller

    # the sensor
    most_flying: float = 0.6  # share of flying points in a ring
    shortest: float = 5.0  # sigma: a shorter flight is indistinguishable from a shift of all points
    doubt: float = 20.0  # honest points that the prior adds to every ring
    equal: float = 2.0  # prior weight of equal viewpoints: a flying point of one looks like an honest one of another
    strays: tuple[float, float] = (0.002, 0.4)  # range of their share

    # ends and gaps
    gap_radii: float = 1.5  # a shorter stretch without points is no gap; also the edge of a gap, where its cause is near
    lone: float = 0.15  # of the usual density: an end with fewer points is a stray

    # doubts
    refused: float = 0.05  # of L: a curve found without guide points that is further off is refused
    length_agrees: float = 0.01  # of L, as a tape measures
    free_agrees: float = 0.03  # of L, with a free end, which a scan may show short
    radius_agrees: float = 0.15  # the mean distance of the points
    tangent_agrees: float = 0.15  # rad, besides the bend between the last seen point and the clamp
    most_bent: float = 0.6  # rad: largest such bend
    beside: float = 2.5  # sigma: largest offset of an end from its clamp, if more than r
    reached: float = 2.0  # an end that comes this near its clamp was seen
    significant: float = 25.0  # chi-squared of a pull with two degrees of freedom
    pulled: float = 0.5  # sigma: mean pull of the points towards another curve
    pulled_radii: float = 0.1  # the same where the noise is smaller
    long_gap: float = 0.16  # of L: longest gap that may be interpolated
    vague: float = 1e-3  # of L: a larger standard deviation, above `on` too, is a guess
    kink: float = 0.7  # curvature times r out of reach of a cable
    enough: int = 20  # points near the curve at a station, from which their share on it counts
    unexplained: float = 0.4  # smallest share of the points within r of the surface that must lie on it


USUAL = ExtractionSettings()
