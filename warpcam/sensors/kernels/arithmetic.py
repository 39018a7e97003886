"""Arithmetic that is quick on a GPU; on a CPU it is that of Warp."""

import warp as wp


@wp.func_native("""
#if defined(__CUDA_ARCH__)
return __powf(base, exponent);
#else
return wp::pow(base, exponent);
#endif
""")
def power(base: wp.float32, exponent: wp.float32) -> wp.float32:
    """``base ** exponent`` of a base of at least 0 and an exponent above 0, on CUDA to a few millionths of it."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
float reciprocal;
asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(reciprocal) : "f"(divisor));
const float nearly = number * reciprocal, rest = fmaf(-divisor, nearly, number);
return rest == rest ? fmaf(rest, reciprocal, nearly) : nearly;
#else
return number / divisor;
#endif
""")
def quotient(number: wp.float32, divisor: wp.float32) -> wp.float32:
    """``number / divisor`` of numbers that are not near the ends of the exponents.

    On CUDA one step of Newton's method behind an approximate reciprocal, which a loop over one divisor keeps;
    ``native/core/platform.h`` has the same function for native code.
    """
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
return rsqrtf(number);
#else
return 1.0f / wp::sqrt(number);
#endif
""")
def inverse_root(number: wp.float32) -> wp.float32:
    """``1 / sqrt(number)`` of a number above 0."""
    ...
