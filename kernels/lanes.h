/* One source for CPU and GPU: vectors of VW floats. A CPU has VW = its SIMD width, a GPU VW = 1 and
 * many work-items. No control flow on vector comparisons: scalar ones give 1, vector ones -1, while
 * select() works on the sign of both.
 *
 *   VW      1 | 2 | 4 | 8 | 16   floats per vector
 *   NATIVE  0 | 1                EXP, LOG, SIN, COS: the library's | the device's (of unspecified
 *                                precision)
 */
#ifndef CLN_LANES_H
#define CLN_LANES_H

#ifndef VW
#define VW 8
#endif

/* Every function that is not a kernel. Always inlined: PoCL 3.1 passes arguments that spill to the
 * stack wrongly (seen: a 13-argument helper read other memory and returned NaN). */
#define HELPER static __attribute__((always_inline))
#define UNROLL(i, n) _Pragma("unroll") for (int i = 0; i < (n); i++)

#define CLN_PASTE_(a, b) a##b
#define CLN_PASTE(a, b)  CLN_PASTE_(a, b)

#if VW == 1
typedef float vf;
typedef uint vu;
typedef int vi;
#define VLOAD(p)     (*(p))
#define VSTORE(v, p) (*(p) = (v))
#define V_TO_FLOAT   convert_float
#define V_TO_INT     convert_int
#define V_TO_UINT    convert_uint
#define V_AS_FLOAT   as_float
#define V_AS_UINT    as_uint
typedef ushort vh;
#define V_TO_USHORT convert_ushort
#else
typedef CLN_PASTE(float, VW) vf;
typedef CLN_PASTE(uint, VW) vu;
typedef CLN_PASTE(int, VW) vi;
#define VLOAD(p)     CLN_PASTE(vload, VW)(0, p)
#define VSTORE(v, p) CLN_PASTE(vstore, VW)(v, 0, p)
#define V_TO_FLOAT   CLN_PASTE(convert_float, VW)
#define V_TO_INT     CLN_PASTE(convert_int, VW)
#define V_TO_UINT    CLN_PASTE(convert_uint, VW)
#define V_AS_FLOAT   CLN_PASTE(as_float, VW)
#define V_AS_UINT    CLN_PASTE(as_uint, VW)
typedef CLN_PASTE(ushort, VW) vh;
#define V_TO_USHORT CLN_PASTE(convert_ushort, VW)
#endif

/* VSTORE of floats (VSTORE_IN; VSTORE8_IN: eight of them) or of 16-bit elements (VSTORE_H) to an
 * address space, in one instruction. PoCL's vstore stores four elements at a time, and LLVM does
 * not join the parts of 16. */
#if defined(__x86_64__) || defined(__aarch64__)
typedef float8 float8_anywhere __attribute__((aligned(4), may_alias));
#define VSTORE8_IN(space, v, p) (*(space float8_anywhere *)(p) = (v))
#else
#define VSTORE8_IN(space, v, p) vstore8(v, 0, p)
#endif
#if VW > 1 && (defined(__x86_64__) || defined(__aarch64__))
typedef vf vf_anywhere __attribute__((aligned(4), may_alias));
typedef vh vh_anywhere __attribute__((aligned(2), may_alias));
#define VSTORE_IN(space, v, p) (*(space vf_anywhere *)(p) = (v))
#define VSTORE_H(space, v, p)  (*(space vh_anywhere *)(p) = (v))
#else
#define VSTORE_IN(space, v, p) VSTORE(v, p)
#define VSTORE_H(space, v, p)  VSTORE(v, p)
#endif

/* Interleaves the lanes of a's and b's first halves (LO) or second halves (HI), in one instruction;
 * PoCL's shuffle2, .even and .odd take several. */
#if VW == 2
#define V_FIRST  0, 2
#define V_SECOND 1, 3
#elif VW == 4
#define V_FIRST  0, 4, 1, 5
#define V_SECOND 2, 6, 3, 7
#elif VW == 8
#define V_FIRST  0, 8, 1, 9, 2, 10, 3, 11
#define V_SECOND 4, 12, 5, 13, 6, 14, 7, 15
#elif VW == 16
#define V_FIRST  0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23
#define V_SECOND 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31
#endif
#if defined(__x86_64__) || defined(__aarch64__)
#define V_ZIP_LO(a, b) __builtin_shufflevector(a, b, V_FIRST)
#define V_ZIP_HI(a, b) __builtin_shufflevector(a, b, V_SECOND)
#else
#define V_ZIP_LO(a, b) shuffle2(a, b, (vu)(V_FIRST))
#define V_ZIP_HI(a, b) shuffle2(a, b, (vu)(V_SECOND))
#endif

/* V_IOTA: lane numbers 0 .. VW-1; V_SUM: the sum over lanes in a fixed order. */
#if VW == 1
#define V_IOTA   0u
#define V_SUM(v) (v)
#elif VW == 2
#define V_IOTA   (uint2)(0, 1)
#define V_SUM(v) ((v).x + (v).y)
#elif VW == 4
#define V_IOTA   (uint4)(0, 1, 2, 3)
HELPER float v_sum4(float4 v)
{
    const float2 b = v.lo + v.hi;
    return b.x + b.y;
}
#define V_SUM(v) v_sum4(v)
#elif VW == 8
#define V_IOTA   (uint8)(0, 1, 2, 3, 4, 5, 6, 7)
HELPER float v_sum8(float8 v)
{
    const float4 a = v.lo + v.hi;
    const float2 b = a.lo + a.hi;
    return b.x + b.y;
}
#define V_SUM(v) v_sum8(v)
#elif VW == 16
#define V_IOTA   (uint16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
HELPER float v_sum16(float16 v)
{
    const float8 c = v.lo + v.hi;
    const float4 a = c.lo + c.hi;
    const float2 b = a.lo + a.hi;
    return b.x + b.y;
}
#define V_SUM(v) v_sum16(v)
#else
#error "VW must be 1, 2, 4, 8 or 16"
#endif

/* Whether a comparison holds in any lane. */
#if VW == 1
#define V_ANY(c) (c)
#else
#define V_ANY(c) any(c)
#endif

#ifndef NATIVE
#define NATIVE 0
#endif
#if NATIVE
#define EXP(x) native_exp(x)
#define LOG(x) native_log(x)
#define SIN(x) native_sin(x)
#define COS(x) native_cos(x)
#else
#define EXP(x) exp(x)
#define LOG(x) log(x)
#define SIN(x) sin(x)
#define COS(x) cos(x)
#endif

/* 1 - exp(-x) for x >= 0 to 1e-6 relative, for floats and vectors (T: type): a series where the
 * difference would cancel. The library's expm1 is several times slower on PoCL. */
#define ONE_MINUS_EXP(T, x)                                                                        \
    select((T)(1.0f) - EXP(-(x)),                                                                  \
           (x) * MAD((x), MAD((x), MAD((x), MAD((x), (T)(8.3333333e-3f), (T)(-4.1666667e-2f)),     \
                                       (T)(1.6666667e-1f)),                                        \
                              (T)(-0.5f)),                                                         \
                     (T)(1.0f)),                                                                   \
           (x) < (T)(0.15f))

/* fma if it is one instruction, else a multiply and an add. PoCL 3.1 lacks the standard's
 * FP_FAST_FMAF. */
#if defined(FP_FAST_FMAF) || defined(__FMA__)
#define MAD(a, b, c) fma(a, b, c)
#else
#define MAD(a, b, c) mad(a, b, c)
#endif

#endif
