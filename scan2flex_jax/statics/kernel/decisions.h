// The decisions of a step of MixedNewton (`statics/newton.py`), under the names that they have there; for CPU and GPU.

INLINE double larger(double a, double b) { return a > b || a != a ? a : b; }

// As in `NewtonState`.
struct State {
  double lent = 0.0, size = 1.0, share = 0.0;  // share: what the nodes move by, of the twist or, in a push, of the mode
  bool own = true, first = true, was_indefinite = false, settling = false, done = false, finite = true;
  bool small = false, definite = false, push = false;
  int negative = 0, steps = 0;

  INLINE bool over(long long most) const { return done || steps >= most || !finite; }

  INLINE bool looking(double atol) const { return size < atol; }

  // From the negative pivots and the largest motion of a node.
  INLINE void judge(int pivots, double now, double atol) {
    negative = pivots;
    small = now < SETTLED;
    definite = negative == 0 && isfinite(now);
    push = definite && was_indefinite && small && settling;
    done = looking(atol) && definite;
  }

  // `close`: forces are handed on from element to element; `of_law`: the elements have their own stiffness; `home`: displacement
  // of the new mode towards the start, of interest in a push.
  INLINE void decide(double now, bool close, bool of_law, double home) {
    share = push ? (home < 0.0 ? -PUSH : PUSH) : definite && !done ? fmin(1.0, LONGEST / now) : 0.0;
    const bool newton = definite && !push && lent == 0.0 && (!first || close);
    size = newton && of_law ? now : 1.0;
    own = (first ? close : own) || (newton && small);
    lent = !definite ? fmax(GROW * lent, FIRST) : lent < NONE ? 0.0 : lent / SHRINK;
    if (definite) settling = small && !push;
    first = first && !definite;
    was_indefinite = !definite;
    steps++;
  }
};
