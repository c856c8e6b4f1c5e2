/* Counter-based random numbers on the device: Philox4x32-10, the twin of host/base/rng.c (same words,
 * same bits), and a cheap vector hash for the per-element slopes of RReLU, where Philox would cost more
 * than the layer. */
#ifndef CLN_RNG_CL
#define CLN_RNG_CL

#define STREAM_GRID    3u
#define STREAM_SAMPLES 4u
#define STREAM_POINTS  6u

HELPER uint4 philox4x32(uint4 c, uint2 k)
{
    for (int round = 0; round < 10; round++) {
        const uint hi0 = mul_hi(0xD2511F53u, c.x), lo0 = 0xD2511F53u * c.x;
        const uint hi1 = mul_hi(0xCD9E8D57u, c.z), lo1 = 0xCD9E8D57u * c.z;

        c = (uint4)(hi1 ^ c.y ^ k.x, lo1, hi0 ^ c.w ^ k.y, lo0);
        k += (uint2)(0x9E3779B9u, 0xBB67AE85u);
    }
    return c;
}

/* Four uniforms in [0, 1), 24 bits each. */
HELPER float4 uniform4(uint2 seed, uint stream, uint step, uint index, uint draw)
{
    const uint4 bits =
        philox4x32((uint4)(index, stream << 24 | (draw & 0xFFFFFFu), step, 0u), seed);

    return convert_float4(bits >> 8) * 0x1p-24f;
}

/* A well-mixed 32-bit hash (two multiply-xorshift rounds, constants of C. Wellons' "lowbias32"). */
HELPER vu hash_lanes(vu x)
{
    x ^= x >> 16;
    x *= 0x21F0AAADu;
    x ^= x >> 15;
    x *= 0xD35A2D97u;
    x ^= x >> 15;
    return x;
}

/* Uniforms in [0, 1), one a lane. */
HELPER vf uniform_lanes(uint key, uint index)
{
    return V_TO_FLOAT(hash_lanes((index + V_IOTA) * 0x9E3779B9u ^ key) >> 8) * 0x1p-24f;
}

#endif
