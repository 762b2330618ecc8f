// Eight numbers at a time, one of each of eight elements or nodes.
#include <algorithm>
#include <cmath>
#include <cstdint>

namespace {

constexpr int W = 8;  // elements or nodes at a time
typedef double lanes __attribute__((vector_size(W * sizeof(double))));
typedef int64_t truths __attribute__((vector_size(W * sizeof(int64_t))));
using Read = const lanes *__restrict;
using Write = lanes *__restrict;

inline lanes all(double x) { return lanes{} + x; }

// A function of the C library; once where all lanes have one argument, as in a branch that no lane takes.
template <class F>
inline lanes each(F f, lanes x, lanes y) {
  bool alike = true;
  for (int k = 1; k < W; k++) alike &= x[k] == x[0] && y[k] == y[0];
  if (alike) return all(f(x[0], y[0]));
  for (int k = 0; k < W; k++) x[k] = f(x[k], y[k]);
  return x;
}
inline lanes lanes_div(lanes x, lanes y) { return x / y; }
inline lanes lanes_sqrt(lanes x) {
  for (int k = 0; k < W; k++) x[k] = std::sqrt(x[k]);
  return x;
}
inline lanes lanes_sin(lanes x) { return each([](double a, double) { return std::sin(a); }, x, x); }
inline lanes lanes_cos(lanes x) { return each([](double a, double) { return std::cos(a); }, x, x); }
inline lanes lanes_tan(lanes x) { return each([](double a, double) { return std::tan(a); }, x, x); }
inline lanes lanes_atan2(lanes y, lanes x) { return each([](double a, double b) { return std::atan2(a, b); }, y, x); }
inline lanes lanes_max(lanes x, lanes y) { return (x > y) | (x != x) ? x : y; }  // NaN stays NaN
inline lanes lanes_min(lanes x, lanes y) { return (x < y) | (x != x) ? x : y; }

// Entries of elements or nodes `first`, `first + 1`, ... of `count`, one in each lane; the last one fills up.
void pack(lanes *to, const double *from, int entries, int stride, int first, int count) {
  for (int k = 0; k < W; k++) {
    const double *one = from + static_cast<size_t>(std::min(first + k, count - 1)) * stride;
    double *lane = reinterpret_cast<double *>(to) + k;
    for (int i = 0; i < entries; i++) lane[W * i] = one[i];
  }
}

void unpack(double *to, const lanes *from, int entries, int stride, int first, int count) {
  for (int k = 0; k < W && first + k < count; k++) {
    double *one = to + static_cast<size_t>(first + k) * stride;
    const double *lane = reinterpret_cast<const double *>(from) + k;
    for (int i = 0; i < entries; i++) one[i] = lane[W * i];
  }
}

}  // namespace
