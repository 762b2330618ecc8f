// The kernel of a GPU (`settle.cu`) on a CPU: each thread of a block a fiber, which runs from barrier to barrier in random order.
#include <ucontext.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <random>
#include <vector>

using std::isfinite;

#define INLINE inline
#define KERNEL static
#define SHARED(type, name, count) type *name = reinterpret_cast<type *>(small)
#define DYNAMIC_SHARED(name) double *name = large
#define UNROLL

namespace {

constexpr size_t STACK = 1 << 20;
struct Fiber {
  ucontext_t context;
  std::unique_ptr<char[]> stack;
  double given[2];  // to its warp and, below, to its block; the one before may still be read
  int votes[2], turn = 0, ballot = 0;
};
struct {
  int x;
} threadIdx;
ucontext_t scheduler;
std::vector<Fiber> fibers;
std::vector<int> ready, of_block, of_warp[64];
char small[1 << 14];
double large[1 << 17];

void wait(std::vector<int> &waiting, size_t all) {
  const int me = threadIdx.x;
  waiting.push_back(me);
  if (waiting.size() == all) {
    ready.insert(ready.end(), waiting.begin(), waiting.end());
    waiting.clear();
  }
  swapcontext(&fibers[me].context, &scheduler);
}
void __syncthreads() { wait(of_block, fibers.size()); }
void __syncwarp(unsigned mask) { wait(of_warp[threadIdx.x / 32], __builtin_popcount(mask)); }
int __syncthreads_or(int x) {
  const int ballot = fibers[threadIdx.x].ballot ^= 1;
  fibers[threadIdx.x].votes[ballot] = x != 0;
  __syncthreads();
  int any = 0;
  for (const Fiber &f : fibers) any |= f.votes[ballot];
  return any;
}
double __shfl_sync(unsigned mask, double x, int lane) {
  const int turn = fibers[threadIdx.x].turn ^= 1;
  fibers[threadIdx.x].given[turn] = x;
  __syncwarp(mask);
  return fibers[threadIdx.x / 32 * 32 + lane].given[turn];
}
double __shfl_xor_sync(unsigned mask, double x, int bits) { return __shfl_sync(mask, x, threadIdx.x % 32 ^ bits); }
bool __any_sync(unsigned mask, bool x) {
  for (int k = 1; k < __builtin_popcount(mask); k *= 2) x |= __shfl_xor_sync(mask, x, k) != 0.0;
  return x;
}
int atomicAdd(int *p, int x) { return (*p += x) - x; }
void atomicMax(unsigned long long *p, unsigned long long x) { *p = x > *p ? x : *p; }
long long __double_as_longlong(double x) {
  long long y;
  memcpy(&y, &x, 8);
  return y;
}
double __longlong_as_double(long long x) {
  double y;
  memcpy(&y, &x, 8);
  return y;
}
inline double reciprocal(double x) { return x == 0.0 ? NAN : 1.0 / x; }
inline double lanes_sqrt(double x) { return std::sqrt(x); }
inline double lanes_sin(double x) { return std::sin(x); }
inline double lanes_cos(double x) { return std::cos(x); }
inline double lanes_tan(double x) { return std::tan(x); }

}  // namespace

#include "settle.cu"

namespace {

const rods::Operands *operands;

void one() {
  rods::settle(*operands);
  setcontext(&scheduler);
}

}  // namespace

// One block; 1 if threads wait for each other for ever.
extern "C" int launch(const rods::Operands *given, int seed) {
  static_assert(rods::ROD_BYTES * RODS <= sizeof large && sizeof(rods::Slot) * RODS <= sizeof small);
  std::mt19937 random(seed);
  operands = given;
  std::fill_n(large, sizeof large / 8, NAN);
  fibers = std::vector<Fiber>(rods::THREADS);
  for (int t = 0; t < rods::THREADS; t++) {
    Fiber &f = fibers[t];
    f.stack.reset(new char[STACK]);
    getcontext(&f.context);
    f.context.uc_stack.ss_sp = f.stack.get(), f.context.uc_stack.ss_size = STACK;
    makecontext(&f.context, one, 0);
    ready.push_back(t);
  }
  while (!ready.empty()) {
    std::swap(ready[random() % ready.size()], ready.back());
    threadIdx.x = ready.back();
    ready.pop_back();
    swapcontext(&scheduler, &fibers[threadIdx.x].context);
  }
  bool stuck = !of_block.empty();
  for (const auto &waiting : of_warp) stuck |= !waiting.empty();
  return stuck;
}
