// MixedNewton of `statics/newton.py` on a GPU: RODS rods of N elements in a block, each from its first step to its last on the
// chip, with one thread for each element; a rod that is solved makes room for the next one.
//
// The block-tridiagonal matrix is in shared memory, eliminated from both ends to the middle by sixteen lanes for each rod. The
// arithmetic of elements and the decisions are those of the CPU (`solver.h`). Arrays are [rod][entry][element or node].
#ifndef KERNEL  // a test has its own, for a CPU
#define INLINE __device__ __forceinline__
#define KERNEL extern "C" __global__ __launch_bounds__(THREADS)
#define SHARED(type, name, count) __shared__ type name[count]
#define DYNAMIC_SHARED(name) extern __shared__ double name[]
#define UNROLL _Pragma("unroll")

INLINE double reciprocal(double x) {  // to rounding, of zero NaN; without the branches of a division
  double y;
  asm("rcp.approx.ftz.f64 %0, %1;" : "=d"(y) : "d"(x));
  const double e = fma(-x, y, 1.0);
  return fma(y, fma(e, e, e), y);
}
INLINE double lanes_sqrt(double x) {
  double y;
  asm("rsqrt.approx.ftz.f64 %0, %1;" : "=d"(y) : "d"(x));
  const double e = fma(-x * y, y, 1.0);
  y = fma(y, e * fma(0.375, e, 0.5), y);
  const double s = x * y;
  return x == 0.0 ? x : fma(0.5 * y, fma(-s, s, x), s);
}
// angles below some turns: without the branch for large ones, which needs memory
constexpr double HALF_TURNS = 1.0 / 3.14159265358979323846;
INLINE double lanes_sin(double x) { return sinpi(x * HALF_TURNS); }
INLINE double lanes_cos(double x) { return cospi(x * HALF_TURNS); }
INLINE double lanes_tan(double x) {
  double s, c;
  sincospi(x * HALF_TURNS, &s, &c);
  return s * reciprocal(c);
}
#endif

namespace rods {

typedef double lanes;  // one thread, one element or node
typedef bool truths;
INLINE double all(double x) { return x; }
INLINE bool all(bool x) { return x; }
INLINE double lanes_div(double x, double y) { return x * reciprocal(y); }
INLINE double lanes_atan2(double y, double x) { return atan2(y, x); }
INLINE double lanes_max(double x, double y) { return x > y || x != x ? x : y; }
INLINE double lanes_min(double x, double y) { return x < y || x != x ? x : y; }

#include "constants.inc"
#include "decisions.h"
#include "elements.inc"

constexpr int NODES = N + 1;
constexpr int PAD = N % 2, LAST = N + PAD, HALF = LAST / 2;  // an odd number of elements has a first node without stiffness
constexpr int THREADS = (RODS * (NODES > 16 ? NODES : 16) + 31) / 32 * 32;  // the last ones: the last node of each rod
// row of a node: lower triangle of its diagonal block, upper block (of the second half transposed), gradient, followed
constexpr int U = 21, G = 57, F = 63, ROW = 69, ROD_BYTES = (LAST + 1) * ROW * 8;
// rows of `kept`, an entry for each node or element: r, R (these are results), mode, forces, x, n, K (lower triangle)
constexpr int R = 3, MODE = 12, FORCES = 18, X = 24, K = 36, KEPT = 57;

struct Operands {
  const double *ds, *stiffness, *natural, *within, *force, *lever, *position, *rotation, *held, *r, *R, *mode, *lendable, *atol;
  const long long *most;
  double *kept;
  int *counts;  // of a rod: steps, negative pivots, whether steps were exhausted; and of the first, rods begun
  int rods;
};
struct Slot {
  State state;
  double ds, length, lendable, of_mode;
  unsigned long long left, large, most;  // bits of largest values
  int rod;
  bool running, fresh, of_law;
};

INLINE unsigned long long bits(double x) { return __double_as_longlong(x) & ~(1ull << 63); }
INLINE double number(unsigned long long x) { return __longlong_as_double(x); }
INLINE constexpr int low(int a, int b) { return a > b ? a * (a + 1) / 2 + b : b * (b + 1) / 2 + a; }
INLINE bool close(const Slot &z) { return !z.state.first || number(z.left) <= LEFT * number(z.large); }
INLINE bool over(const Operands &o, const Slot &z) { return z.state.over(o.most[z.rod]); }

// Inputs of `section_forces` and `element` for element e; P: from `kept`.
struct Element {
  const double *P, *stiffness, *natural, *force, *lever;
  double ds, of_strains, stretching, lent, lendable, within[6];
  bool loaded, of_law = true;

  INLINE Element(const Operands &o, const Slot &z, const double *kept, int e)
      : P(kept + e), stiffness(o.stiffness + (size_t)z.rod * 21 * N + e), natural(o.natural + (size_t)z.rod * 6 * N + e),
        force(o.force + (size_t)z.rod * 3 * NODES + e), lever(o.lever + (size_t)z.rod * 3 * NODES + e), ds(z.ds), lent(z.state.lent),
        lendable(z.lendable), loaded(e == 0) {
    const bool looking = z.state.looking(o.atol[z.rod]);
    of_strains = looking || z.state.first ? 1.0 : 0.0;
    stretching = looking || close(z) ? 1.0 : 0.0;
    const double *from = o.within + (size_t)z.rod * 6 * N + e;
    double of[stiffened::in::size], found[stiffened::out::size];
    UNROLL for (int i = 0; i < 6; i++) within[i] = from[i * N];
    if (z.state.own) return;
    UNROLL for (int i = 0; i < 9; i++) of[stiffened::in::within + i] = within[low(i / 3, i % 3)];
    of[stiffened::in::own] = 0.0;
    stiffened::run<const double *, double *>(of, found);
    UNROLL for (int i = 0; i < 9; i++) within[low(i / 3, i % 3)] = found[stiffened::out::within + i];
    of_law = found[stiffened::out::own] != 0.0;
  }

  INLINE double operator[](int i) const {
    namespace at = element::in;
    if (i < at::stiffness) return ds;
    if (i < at::natural) return stiffness[N * low((i - at::stiffness) / 6, (i - at::stiffness) % 6)];
    if (i < at::within) return natural[N * (i - at::natural)];
    if (i < at::r) return within[low((i - at::within) / 3, (i - at::within) % 3)];
    if (i < at::R) return P[(i - at::r) % 3 * NODES + (i - at::r) / 3];
    if (i < at::force) return P[(R + (i - at::R) % 9) * NODES + (i - at::R) / 9];
    if (i < at::lever) return load(force, i - at::force);
    if (i < at::forces) return load(lever, i - at::lever);
    if (i < at::of_strains) return P[(FORCES + i - at::forces) * NODES];
    if (i < at::stretching) return of_strains;
    if (i < at::lent) return stretching;
    if (i < at::lendable) return lent;
    if (i < at::mode) return lendable;
    return P[(MODE + (i - at::mode) % 6) * NODES + (i - at::mode) / 6];
  }

  // A node's load counts in the element before it.
  INLINE double load(const double *x, int i) const { return i >= 3 ? x[(i - 3) * NODES + 1] : loaded ? x[i * NODES] : 0.0; }
};

// Results of `element`: shares of the far node in its row, where they are alone; those of the near node are kept for later.
struct Found {
  double *P, *row, *far;
  bool turned;
  double near[33];

  struct Cell {
    Found &to;
    int i;
    INLINE void operator=(double x) const { to.put(i, x); }
  };
  INLINE Cell operator[](int i) { return {*this, i}; }

  INLINE void put(int i, double x) {
    namespace at = element::out;
    if (i < at::K) P[(X + i) * NODES] = x;
    else if (i < at::T) lower((i - at::K) % 36, [&](int k) { P[(K + k) * NODES] = x; });
    else if (i < at::gradient) return;
    else if (i < at::diagonal) (i - at::gradient < 6 ? near + U : far + G - 6)[i - at::gradient] = x;
    else if (i < at::upper) lower((i - at::diagonal) % 36, [&](int k) { (i - at::diagonal < 36 ? near : far)[k] = x; });
    else if (i < at::followed) row[U + (turned ? (i - at::upper) % 6 * 6 + (i - at::upper) / 6 : i - at::upper)] = x;
    else (i - at::followed < 6 ? near + U + 6 : far + F - 6)[i - at::followed] = x;
  }

  template <class Put>
  INLINE static void lower(int i, Put put) {
    if (i % 6 <= i / 6) put(low(i / 6, i % 6));
  }
};

INLINE void support(const Operands &o, const Slot &z, double *P, int node) {
  if (node != 0 && node != N) return;
  const size_t end = 2 * (size_t)z.rod + (node ? 1 : 0);
  if (o.held[6 * end] > 0.0)
    for (int i = 0; i < 3; i++) P[i * NODES + node] = o.position[3 * end + i];
  if (o.held[6 * end + 3] > 0.0)
    for (int i = 0; i < 9; i++) P[(R + i) * NODES + node] = o.rotation[9 * end + i];
}

// Section forces of element e in space, and the largest of the rod.
INLINE void strain(const Operands &o, Slot &z, const double *P, double *S, int e) {
  double n[section_forces::out::size], most = 0.0;
  section_forces::run<const Element &, double *>(Element(o, z, P, e), n);
  UNROLL for (int i = 0; i < 3; i++) {
    double f = 0.0;
    UNROLL for (int j = 0; j < 3; j++) f += 0.5 * (P[(R + 3 * i + j) * NODES + e] + P[(R + 3 * i + j) * NODES + e + 1]) * n[j];
    S[3 * e + i] = f;
    most = larger(most, fabs(f));
  }
  atomicMax(&z.large, bits(most));
}

// Largest difference between neighbours up to the load between them.
INLINE void jump(const Operands &o, Slot &z, const double *S, int e) {
  if (e == 0) return;
  double left = 0.0;
  UNROLL for (int i = 0; i < 3; i++)
    left = larger(left, fabs(S[3 * e + i] - S[3 * e - 3 + i] + o.force[((size_t)z.rod * 3 + i) * NODES + e]));
  atomicMax(&z.left, bits(left));
}

// An entry of a diagonal block in units of which turning has one.
INLINE double weighted(int k, double x, double ds) { return k < 6 ? x * ds * ds : 0x39dc0u >> k & 1 ? x * ds : x; }

// The near node's shares of element e are added.
INLINE void add(Slot &z, double *S, int e, const double *near) {
  double *row = S + e * ROW, most = 0.0;
  UNROLL for (int k = 0; k < 33; k++) {
    double &x = row[k < U ? k : k - U + G];
    x = e ? x + near[k] : near[k];
    if (k < U) most = larger(most, weighted(k, fabs(x), z.ds));
  }
  if (e > 0) atomicMax(&z.most, bits(most));  // those of the ends: after elimination
}

// Zero gradient, unit diagonal for held motions of one end, by eight lanes; the first half also clears the first row of an odd rod.
INLINE void eliminate(const double *held, double *S, int end, int c) {
  double *row = S + (end ? N : 0) * ROW, *link = S + (end ? N - 1 : 0) * ROW + U;
  for (int k = c; k < 36; k += 8) {
    const int a = k / 6, b = k % 6;
    const double ka = 1.0 - held[a], kb = 1.0 - held[b];
    if (b <= a) row[low(a, b)] = row[low(a, b)] * ka * kb + (a == b ? 1.0 - ka : 0.0);
    link[k] *= ka;  // rows of the end's own node in both halves
    if (b == 0) row[G + a] *= ka, row[F + a] *= ka;
  }
  if (PAD && !end)
    for (int k = c; k < ROW; k += 8) S[k - ROW] = k == 0 || k == 2 || k == 5 || k == 9 || k == 14 || k == 20 ? 1.0 : 0.0;
}

// LDL' of A (lower triangle) without exchanges; a pivot that is rounding noise leaves its unknown zero. Solves for v.
INLINE int reduce(double *A, const double *scale, double *v) {
  int count = 0;
  double inverse[6];
  UNROLL for (int j = 0; j < 6; j++) {
    const double pivot = A[low(j, j)];
    const bool neutral = fabs(pivot) <= scale[j];
    count += pivot < 0.0 && !neutral;
    inverse[j] = neutral ? 0.0 : reciprocal(pivot);
    double l[6];
    UNROLL for (int i = j + 1; i < 6; i++) l[i] = A[low(i, j)] * inverse[j];
    UNROLL for (int i = j + 1; i < 6; i++) {
      UNROLL for (int k = j + 1; k <= i; k++) A[low(i, k)] -= l[i] * A[low(k, j)];
      v[i] -= l[i] * v[j];
    }
    UNROLL for (int i = j + 1; i < 6; i++) A[low(i, j)] = l[i];
  }
  UNROLL for (int j = 5; j >= 0; j--) {
    v[j] *= inverse[j];
    UNROLL for (int i = j + 1; i < 6; i++) v[j] -= A[low(i, j)] * v[i];
  }
  return count;
}

// Block elimination from both ends to the middle, two directions of eight lanes, each with one right-hand side: six columns of
// the upper block, -gradient and `followed`, whose place the two motions take. Returns the number of negative pivots.
INLINE int solve(double *S, double ds, double most, int lane, unsigned mask) {
  const int half = lane >> 3 & 1, c = lane & 7, base = lane & 24;
  for (int k = lane & 15; k < 42; k += 16) most = larger(most, weighted(k % 21, fabs(S[(k < 21 ? 0 : N * ROW) + k % 21]), ds));
  UNROLL for (int m = 8; m; m >>= 1) most = larger(most, __shfl_xor_sync(mask, most, m));
  const double turn = HOLD * most, hold = turn / (ds * ds);
  S -= PAD * ROW;
  int count = 0;
  double w[6] = {};
  _Pragma("unroll 1") for (int k = 0; k <= HALF; k++) {  // last the node in the middle, in both directions
    const bool middle = k == HALF;
    const int node = half ? LAST - k : k, link = half ? (k ? node : LAST - 1) : (k ? node - 1 : 0), next = half ? node - 1 : node;
    double *row = S + node * ROW, *M = S + link * ROW + U, A[21], d[6], scale[6], v[6];
    UNROLL for (int a = 0; a < 6; a++) {
      double one = M[a] * w[0], two = M[6 + a] * w[1];
      UNROLL for (int j = 2; j < 6; j += 2) one += M[6 * j + a] * w[j], two += M[6 * j + 6 + a] * w[j + 1];
      d[a] = one + two;
    }
    if (middle)
      UNROLL for (int a = 0; a < 6; a++) d[a] += __shfl_xor_sync(mask, d[a], 8);
    __syncwarp(mask);
    if (c < 6 && k > 0)
      UNROLL for (int a = 0; a < 6; a++) M[6 * a + c] = w[a];
    UNROLL for (int a = 0; a < 6; a++)
      UNROLL for (int b = 0; b <= a; b++) {
        double x = row[low(a, b)];
        if (a == b) {
          x += a < 3 ? hold : turn;
          scale[a] = NEUTRAL * fabs(x);
        }
        A[low(a, b)] = x - __shfl_sync(mask, d[a], base + b);
      }
    const double *from = c < 6 ? S + (middle ? 0 : next) * ROW + U + c : row + G + 6 * (c - 6);
    const int stride = c < 6 ? 6 : 1;
    UNROLL for (int a = 0; a < 6; a++) {
      const double x = from[a * stride];
      v[a] = c == 6 ? -x - d[a] : c == 7 ? x - d[a] : x;
    }
    if (middle) {
      count += __shfl_xor_sync(mask, count, 8);
      __syncwarp(mask);
    }
    count += reduce(A, scale, v);
    UNROLL for (int a = 0; a < 6; a++) w[a] = v[a];
    if (c >= 6 && !(middle && half))
      UNROLL for (int a = 0; a < 6; a++) row[G + 6 * (c - 6) + a] = v[a];
    __syncwarp(mask);
  }
  for (int k = 1; k <= HALF; k++) {
    const int node = half ? HALF + k : HALF - k, before = half ? node - 1 : node + 1, link = half ? node - 1 : node;
    double *row = S + node * ROW + G;
    const double *x = S + before * ROW + G, *carry = S + link * ROW + U + 6 * c;
    if (c < 6) {
      double a[2] = {row[c], 0.0}, b[2] = {row[6 + c], 0.0};
      UNROLL for (int j = 0; j < 6; j++) a[j % 2] -= carry[j] * x[j], b[j % 2] -= carry[j] * x[6 + j];
      row[c] = a[0] + a[1];
      row[6 + c] = b[0] + b[1];
    }
    __syncwarp(mask);
  }
  return count;
}

// The decisions of a step, by sixteen lanes for each rod.
INLINE void decide(const Operands &o, Slot &z, const double *S, int pivots, int lane, unsigned mask) {
  double largest[4] = {};  // displacement and rotation of the twist, of the mode
  for (int node = lane & 15; node < NODES; node += 16)
    UNROLL for (int i = 0; i < 12; i++) largest[i / 3] = larger(largest[i / 3], fabs(S[node * ROW + G + i]));
  UNROLL for (int m = 8; m; m >>= 1)
    UNROLL for (int i = 0; i < 4; i++) largest[i] = larger(largest[i], __shfl_xor_sync(mask, largest[i], m));
  const double now = larger(largest[0] / z.length, largest[1]), of_mode = larger(largest[2] / z.length, largest[3]);
  State state = z.state;
  if (z.running) state.judge(pivots, now, o.atol[z.rod]);
  const bool push = z.running && state.push;
  double home = 0.0;
  if (__any_sync(mask, push)) {
    if (push) {
      const double *P = o.kept + (size_t)z.rod * KEPT * NODES, *start = o.r + (size_t)z.rod * 3 * NODES;
      for (int node = lane & 15; node < NODES; node += 16)
        for (int i = 0; i < 3; i++)
          for (int j = 0; j < 3; j++)
            home += S[node * ROW + F + j] / of_mode * P[(R + 3 * i + j) * NODES + node] * (start[i * NODES + node] - P[i * NODES + node]);
    }
    UNROLL for (int m = 8; m; m >>= 1) home += __shfl_xor_sync(mask, home, m);
  }
  state.decide(now, close(z), z.of_law, home);
  __syncwarp(mask);
  if ((lane & 15) == 0) z.state = state, z.of_mode = 1.0 / of_mode;
}

INLINE double motion(const Slot &z, const double *S, int node, int i) {
  const double *row = S + node * ROW;
  return z.state.share == 0.0 ? 0.0 : z.state.share * (z.state.push ? row[F + i] * z.of_mode : row[G + i]);
}

// Inputs of `predicted_forces` for element e.
struct Ahead {
  const Slot &z;
  const double *P, *S;
  int e;
  INLINE double operator[](int i) const {
    namespace at = predicted_forces::in;
    if (i < at::r) return z.ds;
    if (i < at::R) return P[(i - at::r) % 3 * NODES + (i - at::r) / 3];
    if (i < at::x) return P[(R + (i - at::R) % 9) * NODES + (i - at::R) / 9];
    if (i < at::K) return P[(X + i - at::x) * NODES];
    if (i < at::twist) return P[(K + low((i - at::K) / 6, (i - at::K) % 6)) * NODES];
    return motion(z, S, e + (i - at::twist) / 6, (i - at::twist) % 6);
  }
};

INLINE void foresee(const Slot &z, double *P, const double *S, int e) {
  double forces[predicted_forces::out::size];
  predicted_forces::run<const Ahead &, double *>(Ahead{z, P + e, S, e}, forces);
  UNROLL for (int i = 0; i < 6; i++) P[(FORCES + i) * NODES + e] = forces[i];
}

INLINE void move(Slot &z, double *P, const double *S, int node) {
  double of[moved::in::size], to[moved::out::size], none = 0.0;
  UNROLL for (int i = 0; i < 12; i++) of[i] = P[i * NODES + node];
  UNROLL for (int i = 0; i < 6; i++) of[moved::in::twist + i] = motion(z, S, node, i);
  moved::run<const double *, double *>(of, to);
  UNROLL for (int i = 0; i < 12; i++) P[i * NODES + node] = to[i], none += to[i] - to[i];
  if (!(none == 0.0)) z.state.finite = false;
  UNROLL for (int i = 0; i < 6; i++) {
    const double x = S[node * ROW + F + i] * z.of_mode;
    if (isfinite(x)) P[(MODE + i) * NODES + node] = x;
  }
}

// Takes the next rod of the queue, if there is one, for a slot whose rod is solved; by one thread.
INLINE void refill(const Operands &o, Slot &z, bool solved) {
  if (solved) {
    int *count = o.counts + 4 * (size_t)z.rod;
    count[0] = z.state.steps, count[1] = z.state.negative, count[2] = !z.state.done && z.state.finite;
  }
  z.fresh = false, z.of_law = true, z.left = z.large = z.most = 0;
  if (z.rod >= o.rods || (z.running && !solved)) return;
  z.rod = atomicAdd(o.counts + 3, 1);
  z.running = z.fresh = z.rod < o.rods;
  z.state = State();
  if (z.running) z.ds = o.ds[z.rod], z.length = z.ds * N, z.lendable = o.lendable[z.rod];
}

KERNEL void settle(const Operands o) {
  DYNAMIC_SHARED(space);
  SHARED(Slot, slots, RODS);
  const int t = threadIdx.x, lane = t % 32, of_warp = t / 32 * 2 + lane / 16;
  const int s = t < RODS * N ? t / N : t < RODS * NODES ? t - RODS * N : 0;
  const int e = t < RODS * N ? t % N : t < RODS * NODES ? N : N + 1;
  Slot &z = slots[s];
  double *S = space + (s * (LAST + 1) + PAD) * ROW;
  if (e == 0) z.rod = -1, z.running = false, z.ds = 1.0;
  __syncthreads();
  while (true) {
    const bool solved = z.running && e <= N && over(o, z);
    if (solved) support(o, z, o.kept + (size_t)z.rod * KEPT * NODES, e);
    __syncthreads();
    if (e == 0) refill(o, z, solved);
    if (!__syncthreads_or(e == 0 && z.running)) return;
    const bool running = z.running && e <= N, strained = running && e < N;
    const size_t rod = running ? z.rod : 0;
    double *P = o.kept + rod * KEPT * NODES;
    if (z.fresh && e < N) {
      for (int i = e; i < 3 * NODES; i += N) P[i] = o.r[rod * 3 * NODES + i];
      for (int i = e; i < 9 * NODES; i += N) P[R * NODES + i] = o.R[rod * 9 * NODES + i];
      for (int i = e; i < 6 * NODES; i += N) P[MODE * NODES + i] = o.mode[rod * 6 * NODES + i], P[FORCES * NODES + i] = 0.0;
    }
    __syncthreads();
    if (running) support(o, z, P, e);
    if (__syncthreads_or(running && z.state.first)) {
      if (strained && z.state.first) strain(o, z, P, S, e);
      __syncthreads();
      if (strained && z.state.first) jump(o, z, S, e);
      __syncthreads();
    }
    Found found{P + e, S + e * ROW, S + (e + 1) * ROW, e + PAD >= HALF};
    if (strained) {
      const Element of(o, z, P, e);
      if (!of.of_law) z.of_law = false;
      element::run<const Element &, Found &>(of, found);
    }
    __syncthreads();
    if (strained) add(z, S, e, found.near);
    __syncthreads();
    if (of_warp < RODS) {
      Slot &y = slots[of_warp];
      const unsigned mask = of_warp / 2 * 2 + 1 < RODS ? 0xffffffffu : 0xffffu;
      double *M = space + (of_warp * (LAST + 1) + PAD) * ROW;
      if (y.running) eliminate(o.held + (size_t)y.rod * 12 + 6 * (lane >> 3 & 1), M, lane >> 3 & 1, lane & 7);
      __syncwarp(mask);
      decide(o, y, M, solve(M, y.ds, number(y.most), lane, mask), lane, mask);
    }
    __syncthreads();
    if (strained && z.state.definite) foresee(z, P, S, e);
    __syncthreads();
    if (running) move(z, P, S, e);
    __syncthreads();
  }
}

}  // namespace rods
