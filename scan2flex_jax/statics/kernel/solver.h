// MixedNewton of `statics/newton.py`: the same steps in the same order, under the names that they have there.
//
// The arithmetic of an element and of a node is in `elements.inc`, translated from the package (`elements.py`); the constants of
// the method are in `constants.inc`, from `newton.py`; what it decides is in `decisions.h`. Here are the sums over the chain and
// the block-tridiagonal system (`statics/blocktridiagonal.py`), on a CPU; `settle.cu` has them on a GPU.
#include <vector>

#include "lanes.h"

namespace {

using std::isfinite;

#define INLINE inline
#include "constants.inc"
#include "decisions.h"
#include "elements.inc"

// The arrays of one rod.
struct Operands {
  const double *ds, *stiffness, *natural, *within, *force, *lever, *position, *rotation, *held, *r, *R, *mode, *lendable, *atol;
  const int64_t *most;
};
struct Results {
  double *r, *R, *gradient, *diagonal, *upper, *ends, *x, *n, *K, *T, *A;
  int64_t *negative, *steps;
  bool *exhausted;
};

// Rods of n elements, one after the other in the same memory.
class Solver {
 public:
  explicit Solver(int n)
      : n(n), nodes(n + 1), groups((n + W - 1) / W), in(groups), out(groups), r(3 * nodes), R(9 * nodes), start(3 * nodes),
        forces(6 * n), mode(6 * nodes), twist(6 * nodes), followed(6 * nodes), gradient(6 * nodes),
        ends(4 * 36), diagonal(6 * nodes), upper(6 * nodes), carry(6 * nodes) {}

  void settle(const Operands &operands, const Results &to) {
    o = operands;
    begin();
    while (!z.over(*o.most)) step();
    support();
    write(to);
    *to.negative = z.negative;
    *to.steps = z.steps;
    *to.exhausted = !z.done && z.finite;
  }

 private:
  struct Input { lanes of[element::in::size]; };
  struct Output { lanes of[element::out::size]; };

  const int n, nodes, groups;
  Operands o{};
  double length = 0.0;
  std::vector<Input> in;
  std::vector<Output> out;
  std::vector<double> r, R, start, forces, mode, twist, followed, gradient, ends;
  // rows of six: diagonal blocks; upper blocks with two right-hand sides; the same after elimination
  std::vector<lanes> diagonal, upper, carry;
  double free[2][6];
  State z;

  void begin() {
    length = *o.ds * n;
    std::copy_n(o.r, 3 * nodes, r.data());
    std::copy_n(o.R, 9 * nodes, R.data());
    start = r;
    std::copy_n(o.mode, 6 * nodes, mode.data());
    std::fill(forces.begin(), forces.end(), 0.0);
    for (int i = 0; i < 12; i++) free[i / 6][i % 6] = 1.0 - o.held[i];
    z = State();
    for (int g = 0; g < groups; g++) {
      lanes *to = in[g].of;
      to[element::in::ds] = all(*o.ds);
      pack(to + element::in::stiffness, o.stiffness, 36, 36, g * W, n);
      pack(to + element::in::natural, o.natural, 6, 6, g * W, n);
      pack(to + element::in::force, o.force, 6, 3, g * W, n);
      pack(to + element::in::lever, o.lever, 6, 3, g * W, n);
      to[element::in::lendable] = all(*o.lendable);
      for (int i = 0; i < 3; i++)  // a node's load counts in the element before it
        for (int k = g ? 0 : 1; k < W; k++) to[element::in::force + i][k] = to[element::in::lever + i][k] = 0.0;
    }
  }

  void support() {
    for (int end = 0; end < 2; end++) {
      const int node = end ? n : 0;
      if (o.held[6 * end] > 0.0) std::copy_n(o.position + 3 * end, 3, &r[3 * node]);
      if (o.held[6 * end + 3] > 0.0) std::copy_n(o.rotation + 9 * end, 9, &R[9 * node]);
    }
  }

  void step() {
    support();
    frames();
    const bool of_law = stiffen(), close = !z.first || handed_on();
    assemble(close);
    const int pivots = factor();
    substitute();
    const double of_mode = largest_motion(followed), now = largest_motion(twist);
    for (double &x : followed) x /= of_mode;  // the new mode
    z.judge(pivots, now, *o.atol);
    z.decide(now, close, of_law, z.push ? homeward() : 0.0);
    for (int i = 0; i < 6 * nodes; i++) twist[i] = z.share == 0.0 ? 0.0 : z.share * (z.push ? followed : twist)[i];
    if (z.definite) predict();
    move();
    for (int i = 0; i < 6 * nodes; i++)
      if (std::isfinite(followed[i])) mode[i] = followed[i];
  }

  // Stiffness of the elements against strain variation; whether it is their own.
  bool stiffen() {
    bool of_law = true;
    for (int g = 0; g < groups; g++) {
      lanes of[stiffened::in::size], found[stiffened::out::size];
      pack(of + stiffened::in::within, o.within, 9, 9, g * W, n);
      of[stiffened::in::own] = all(z.own ? 1.0 : 0.0);
      stiffened::run<Read, Write>(of, found);
      std::copy_n(found + stiffened::out::within, 9, in[g].of + element::in::within);
      for (int k = 0; k < W; k++) of_law &= found[stiffened::out::own][k] != 0.0;
    }
    return of_law;
  }

  void frames() {
    for (int g = 0; g < groups; g++) {
      pack(in[g].of + element::in::r, r.data(), 6, 3, g * W, n);
      pack(in[g].of + element::in::R, R.data(), 18, 9, g * W, n);
    }
  }

  // Whether section forces are handed on from element to element.
  bool handed_on() {
    std::vector<double> section_force(6 * n);
    for (int g = 0; g < groups; g++) {
      lanes now[section_forces::out::size];
      section_forces::run<Read, Write>(in[g].of, now);
      unpack(section_force.data(), now, 6, 6, g * W, n);
    }
    double before[3] = {}, left = 0.0, most = 0.0;
    for (int e = 0; e < n; e++)
      for (int i = 0; i < 3; i++) {
        double f = 0.0;
        for (int j = 0; j < 3; j++) f += 0.5 * (R[9 * e + 3 * i + j] + R[9 * e + 9 + 3 * i + j]) * section_force[6 * e + j];
        most = larger(most, std::fabs(f));
        if (e > 0) left = larger(left, std::fabs(f - before[i] + o.force[3 * e + i]));
        before[i] = f;
      }
    return left <= LEFT * most;
  }

  void assemble(bool close) {
    const bool looking = z.looking(*o.atol);
    std::fill(gradient.begin(), gradient.end(), 0.0);
    std::fill(followed.begin(), followed.end(), 0.0);
    std::fill(diagonal.begin(), diagonal.end(), all(0.0));
    std::fill(upper.begin(), upper.end(), all(0.0));
    for (int g = 0; g < groups; g++) {
      lanes *of = in[g].of;
      pack(of + element::in::forces, forces.data(), 6, 6, g * W, n);
      of[element::in::of_strains] = all(looking || z.first ? 1.0 : 0.0);
      of[element::in::stretching] = all(looking || close ? 1.0 : 0.0);  // carries no information at another start
      of[element::in::lent] = all(z.lent);
      pack(of + element::in::mode, mode.data(), 12, 6, g * W, n);
      element::run<Read, Write>(of, out[g].of);
      for (int e = g * W; e < std::min(n, (g + 1) * W); e++) add(e, reinterpret_cast<double *>(out[g].of) + e % W);
    }
    eliminate();
  }

  // One element's share in the sums, from its lane.
  void add(int e, const double *lane) {
    for (int a = 0; a < 12; a++) {
      const int i = 6 * e + a;
      gradient[i] += lane[W * (element::out::gradient + a)];
      followed[i] += lane[W * (element::out::followed + a)];
      for (int b = 0; b < 6; b++) diagonal[i][b] += lane[W * (element::out::diagonal + 6 * a + b)];
    }
    for (int a = 0; a < 6; a++)
      for (int b = 0; b < 6; b++) upper[6 * e + a][b] = lane[W * (element::out::upper + 6 * a + b)];
  }

  // Zero gradient, unit diagonal for held motions; `ends` keeps the blocks of before.
  void eliminate() {
    for (int end = 0; end < 2; end++) {
      const int node = end ? n : 0, beside = end ? n - 1 : 0;
      for (int a = 0; a < 6; a++)
        for (int b = 0; b < 6; b++) {
          ends[72 * end + 6 * a + b] = diagonal[6 * node + a][b];
          ends[72 * end + 36 + 6 * a + b] = upper[6 * beside + a][b];
        }
    }
    for (int end = 0; end < 2; end++) {
      const int node = end ? n : 0, beside = end ? n - 1 : 0;
      const double *keep = free[end];
      for (int a = 0; a < 6; a++) {
        gradient[6 * node + a] *= keep[a];
        followed[6 * node + a] *= keep[a];
        for (int b = 0; b < 6; b++) {
          diagonal[6 * node + a][b] = diagonal[6 * node + a][b] * keep[a] * keep[b] + (a == b ? 1.0 - keep[a] : 0.0);
          upper[6 * beside + a][b] *= end ? keep[b] : keep[a];
        }
      }
    }
  }

  // Block elimination from the first node to the last, with the right-hand sides -gradient and `followed` in lanes 6 and 7;
  // returns the number of negative pivots.
  int factor() {
    const double ds = *o.ds, unit[6] = {1.0 / ds, 1.0 / ds, 1.0 / ds, 1.0, 1.0, 1.0};
    double most = 0.0;
    for (int i = 0; i < 6 * nodes; i++)
      for (int b = 0; b < 6; b++) most = larger(most, std::fabs(diagonal[i][b]) / (unit[i % 6] * unit[b]));
    int count = 0;
    for (int node = 0; node < nodes; node++) {
      lanes A[6], B[6];
      double scale[6];
      for (int a = 0; a < 6; a++) {
        const int i = 6 * node + a;
        A[a] = diagonal[i];
        A[a][a] += HOLD * most * unit[a] * unit[a];
        scale[a] = NEUTRAL * std::fabs(A[a][a]);
        B[a] = upper[i];
        B[a][6] = -gradient[i];
        B[a][7] = followed[i];
      }
      if (node > 0) downdate(A, B, &upper[6 * node - 6], &carry[6 * node - 6]);
      count += reduce(A, B, scale);
      std::copy_n(B, 6, &carry[6 * node]);
    }
    return count;
  }

  // [A | b] minus U' [carry | y] of the node before.
  static void downdate(lanes *A, lanes *B, const lanes *U, const lanes *before) {
    const truths sides = {0, 0, 0, 0, 0, 0, -1, -1};
    for (int a = 0; a < 6; a++) {
      lanes sum = U[0][a] * before[0];
      for (int k = 1; k < 6; k++) sum += U[k][a] * before[k];
      A[a] -= sides ? all(0.0) : sum;
      B[a] -= sides ? sum : all(0.0);
    }
  }

  // Gauss-Jordan on [A | B] without exchanges; a pivot that is rounding noise leaves its row zero.
  static int reduce(lanes *A, lanes *B, const double *scale) {
    int count = 0;
#pragma GCC unroll 6
    for (int j = 0; j < 6; j++) {
      const double pivot = A[j][j];
      const bool neutral = std::fabs(pivot) <= scale[j];
      count += pivot < 0.0 && !neutral;
      const double inverse = 1.0 / pivot;
      const lanes a = neutral ? all(0.0) : A[j] * inverse, b = neutral ? all(0.0) : B[j] * inverse;
#pragma GCC unroll 6
      for (int i = 0; i < 6; i++)
        if (i != j) {
          const double factor = A[i][j];
          A[i] -= factor * a;
          B[i] -= factor * b;
        }
      A[j] = a;
      B[j] = b;
    }
    return count;
  }

  // The two solutions, from the last node to the first: `twist`, and in place of the forces `followed` the motion under them.
  void substitute() {
    double x[6] = {}, y[6] = {};
    for (int node = n; node >= 0; node--) {
      double next[6], other[6];
      for (int a = 0; a < 6; a++) {
        const double *row = reinterpret_cast<const double *>(&carry[6 * node + a]);
        next[a] = row[6];
        other[a] = row[7];
        for (int k = 0; k < 6; k++) next[a] -= row[k] * x[k], other[a] -= row[k] * y[k];
      }
      std::copy_n(next, 6, x);
      std::copy_n(other, 6, y);
      std::copy_n(x, 6, &twist[6 * node]);
      std::copy_n(y, 6, &followed[6 * node]);
    }
  }

  // Largest motion of a node: rad, or relative to the length.
  double largest_motion(const std::vector<double> &motion) const {
    double moved = 0.0, turned = 0.0;
    for (int i = 0; i < 6 * nodes; i += 6)
      for (int k = 0; k < 3; k++) {
        moved = larger(moved, std::fabs(motion[i + k]));
        turned = larger(turned, std::fabs(motion[i + 3 + k]));
      }
    return larger(moved / length, turned);
  }

  // Displacement of the new mode towards the start.
  double homeward() const {
    double sum = 0.0;
    for (int node = 0; node < nodes; node++)
      for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
          sum += followed[6 * node + j] * R[9 * node + 3 * i + j] * (start[3 * node + i] - r[3 * node + i]);
    return sum;
  }

  void predict() {
    for (int g = 0; g < groups; g++) {
      lanes of[predicted_forces::in::size], found[predicted_forces::out::size];
      of[predicted_forces::in::ds] = all(*o.ds);
      std::copy_n(in[g].of + element::in::r, 24, of + predicted_forces::in::r);  // r, R
      std::copy_n(out[g].of + element::out::x, 48, of + predicted_forces::in::x);  // x, n, K
      pack(of + predicted_forces::in::twist, twist.data(), 12, 6, g * W, n);
      predicted_forces::run<Read, Write>(of, found);
      unpack(forces.data(), found, 6, 6, g * W, n);
    }
  }

  void move() {
    bool ok = true;
    for (int first_node = 0; first_node < nodes; first_node += W) {
      lanes of[moved::in::size], found[moved::out::size];
      pack(of + moved::in::r, r.data(), 3, 3, first_node, nodes);
      pack(of + moved::in::R, R.data(), 9, 9, first_node, nodes);
      pack(of + moved::in::twist, twist.data(), 6, 6, first_node, nodes);
      moved::run<Read, Write>(of, found);
      unpack(r.data(), found + moved::out::r, 3, 3, first_node, nodes);
      unpack(R.data(), found + moved::out::R, 9, 9, first_node, nodes);
      lanes none = all(0.0);
      for (const lanes &x : found) none += x - x;
      for (int k = 0; k < W; k++) ok &= none[k] == 0.0;
    }
    z.finite = ok;
  }

  void write(const Results &to) const {
    std::copy(r.begin(), r.end(), to.r);
    std::copy(R.begin(), R.end(), to.R);
    std::copy(gradient.begin(), gradient.end(), to.gradient);
    std::copy(ends.begin(), ends.end(), to.ends);
    for (int i = 0; i < 6 * nodes; i++)
      for (int b = 0; b < 6; b++) {
        to.diagonal[6 * i + b] = diagonal[i][b];
        if (i < 6 * n) to.upper[6 * i + b] = upper[i][b];
      }
    for (int g = 0; g < groups; g++) {
      const lanes *of = out[g].of;
      unpack(to.x, of + element::out::x, 6, 6, g * W, n);
      unpack(to.n, of + element::out::n, 6, 6, g * W, n);
      unpack(to.K, of + element::out::K, 36, 36, g * W, n);
      unpack(to.T, of + element::out::T, 36, 36, g * W, n);
      unpack(to.A, of + element::out::A, 36, 36, g * W, n);
    }
  }
};

}  // namespace
