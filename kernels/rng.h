/* Counter-based random numbers on the device: Philox4x32-10, the twin of host/base/rng.c (the same
 * bits), and a cheap vector hash, for the slopes of RReLU and wherever Philox would cost more than
 * the work it is for. */
#define STREAM_GRID    3u
#define STREAM_SAMPLES 4u
#define STREAM_POINTS  6u

/* Takes 64-bit products, as PoCL builds mul_hi from four 16-bit products. Words are scalars: every
 * round would have to extract them from a vector. */
HELPER uint4 philox4x32(uint4 c, uint2 k)
{
    uint c0 = c.x, c1 = c.y, c2 = c.z, c3 = c.w, k0 = k.x, k1 = k.y;

#pragma unroll
    for (int round = 0; round < 10; round++) {
        const ulong p0 = (ulong)0xD2511F53u * c0, p1 = (ulong)0xCD9E8D57u * c2;

        c0 = (uint)(p1 >> 32) ^ c1 ^ k0;
        c1 = (uint)p1;
        c2 = (uint)(p0 >> 32) ^ c3 ^ k1;
        c3 = (uint)p0;
        k0 += 0x9E3779B9u;
        k1 += 0xBB67AE85u;
    }
    return (uint4)(c0, c1, c2, c3);
}

/* Four uniforms in [0, 1), 24 bits each. */
HELPER float4 uniform4(uint2 seed, uint stream, uint step, uint index, uint draw)
{
    const uint4 bits =
        philox4x32((uint4)(index, stream << 24 | (draw & 0xFFFFFFu), step, 0u), seed);

    return convert_float4(bits >> 8) * 0x1p-24f;
}

/* A well-mixed 32-bit hash (two multiply-xorshift rounds, constants of C. Wellons' "lowbias32"), of
 * lanes and of one number. */
#define HASH_OF(T, name)   \
    HELPER T name(T x)     \
    {                      \
        x ^= x >> 16;      \
        x *= 0x21F0AAADu;  \
        x ^= x >> 15;      \
        x *= 0xD35A2D97u;  \
        x ^= x >> 15;      \
        return x;          \
    }
HASH_OF(vu, hash_lanes)
HASH_OF(uint, hash_one)

/* Uniforms in [0, 1), one per lane. */
HELPER vf uniform_lanes(uint key, uint index)
{
    return V_TO_FLOAT(hash_lanes((index + V_IOTA) * 0x9E3779B9u ^ key) >> 8) * 0x1p-24f;
}

/* Cheap uniforms, one per lane: a key by Philox, hashed with (index, number, draw). The twin of
 * cln_uniform_hash(). */
HELPER uint stream_key(uint2 seed, uint stream, uint step)
{
    return philox4x32((uint4)(0u, stream << 24, step, 0u), seed).x;
}

HELPER vf uniform_lanes_of(uint key, vu index, vu number, uint draw)
{
    const vu own = hash_lanes(hash_lanes(index ^ key) + number);

    return V_TO_FLOAT(hash_lanes(own + (draw + 1u) * 0x9E3779B9u) >> 8) * 0x1p-24f;
}

/* A standard normal number of (key, index): Box-Muller on two hashes. */
HELPER float normal_number(uint key, uint index)
{
    const uint a = (key ^ 0x27D4EB2Fu) + index * 0x9E3779B9u;
    uint x = a ^ a >> 16, y = 0;

    x *= 0x21F0AAADu;
    x ^= x >> 15;
    x *= 0xD35A2D97u;
    x ^= x >> 15;
    y = x * 0x85EBCA6Bu + 0x165667B1u;
    y ^= y >> 16;
    y *= 0x21F0AAADu;
    y ^= y >> 15;
    return sqrt(-2.0f * LOG((convert_float(x >> 8) + 1.0f) * 0x1p-24f)) *
           cospi(2.0f * convert_float(y >> 8) * 0x1p-24f);
}
