// The solver as a custom call of XLA, for one rod after the other.
#include "xla/ffi/api/ffi.h"

#include "solver.h"

namespace {

namespace ffi = xla::ffi;
using F64 = ffi::Buffer<ffi::F64>;
using S64 = ffi::Buffer<ffi::S64>;
template <class T>
using Out = ffi::Result<T>;

// A batch has leading axes, the same in all arrays.
ffi::Error settled(F64 ds, F64 stiffness, F64 natural, F64 within, F64 force, F64 lever, F64 position, F64 rotation, F64 held, F64 r,
                   F64 R, F64 mode, F64 lendable, F64 atol, S64 most, Out<F64> r_, Out<F64> R_, Out<F64> gradient,
                   Out<F64> diagonal, Out<F64> upper, Out<F64> ends, Out<F64> x, Out<F64> n_, Out<F64> K, Out<F64> T, Out<F64> A,
                   Out<S64> negative, Out<S64> steps, Out<ffi::Buffer<ffi::PRED>> exhausted) {
  const size_t rods = ds.element_count();
  if (rods == 0) return ffi::Error::Success();
  const size_t nodes = r.element_count() / (3 * rods), n = nodes - 1;
  Solver solver(static_cast<int>(n));
  for (size_t i = 0; i < rods; i++) {
    const auto of = [&](const F64 &array, size_t entries) { return array.typed_data() + i * entries; };
    const auto to = [&](Out<F64> &array, size_t entries) { return array->typed_data() + i * entries; };
    const Operands operands{of(ds, 1), of(stiffness, 36 * n), of(natural, 6 * n), of(within, 9 * n), of(force, 3 * nodes),
                            of(lever, 3 * nodes), of(position, 6), of(rotation, 18), of(held, 12), of(r, 3 * nodes),
                            of(R, 9 * nodes), of(mode, 6 * nodes), of(lendable, 1), of(atol, 1), most.typed_data() + i};
    const Results results{to(r_, 3 * nodes), to(R_, 9 * nodes), to(gradient, 6 * nodes), to(diagonal, 36 * nodes),
                          to(upper, 36 * n), to(ends, 144), to(x, 6 * n), to(n_, 6 * n), to(K, 36 * n), to(T, 36 * n),
                          to(A, 36 * n), negative->typed_data() + i, steps->typed_data() + i, exhausted->typed_data() + i};
    solver.settle(operands, results);
  }
  return ffi::Error::Success();
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(scan2flex_settle, settled,
                              ffi::Ffi::Bind()
                                  .Arg<F64>().Arg<F64>().Arg<F64>().Arg<F64>().Arg<F64>().Arg<F64>().Arg<F64>().Arg<F64>()
                                  .Arg<F64>().Arg<F64>().Arg<F64>().Arg<F64>().Arg<F64>().Arg<F64>().Arg<S64>()
                                  .Ret<F64>().Ret<F64>().Ret<F64>().Ret<F64>().Ret<F64>().Ret<F64>().Ret<F64>().Ret<F64>()
                                  .Ret<F64>().Ret<F64>().Ret<F64>().Ret<S64>().Ret<S64>().Ret<ffi::Buffer<ffi::PRED>>());
