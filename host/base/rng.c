/* Philox4x32-10. See rng.h. */
#include "base/rng.h"

void cln_philox(const uint32_t counter[4], const uint32_t key[2], uint32_t out[4])
{
    uint32_t c0 = counter[0], c1 = counter[1], c2 = counter[2], c3 = counter[3];
    uint32_t k0 = key[0], k1 = key[1];

    for (int round = 0; round < 10; round++) {
        uint64_t p0 = (uint64_t)0xD2511F53u * c0;
        uint64_t p1 = (uint64_t)0xCD9E8D57u * c2;
        uint32_t n0 = (uint32_t)(p1 >> 32) ^ c1 ^ k0;
        uint32_t n2 = (uint32_t)(p0 >> 32) ^ c3 ^ k1;

        c1 = (uint32_t)p1;
        c3 = (uint32_t)p0;
        c0 = n0;
        c2 = n2;
        k0 += 0x9E3779B9u;
        k1 += 0xBB67AE85u;
    }
    out[0] = c0;
    out[1] = c1;
    out[2] = c2;
    out[3] = c3;
}

void cln_uniform4(uint64_t seed, uint32_t stream, uint32_t step, uint32_t index, uint32_t draw,
                  float out[4])
{
    const uint32_t counter[4] = {index, stream << 24 | (draw & 0xFFFFFFu), step, 0};
    const uint32_t key[2] = {(uint32_t)seed, (uint32_t)(seed >> 32)};
    uint32_t bits[4];

    cln_philox(counter, key, bits);
    for (int i = 0; i < 4; i++)
        out[i] = (float)(bits[i] >> 8) * 0x1p-24f;
}

uint32_t cln_bounded(uint32_t random, uint32_t n)
{
    return (uint32_t)((uint64_t)random * n >> 32);
}

uint32_t cln_hash(uint32_t x)
{
    x ^= x >> 16;
    x *= 0x21F0AAADu;
    x ^= x >> 15;
    x *= 0xD35A2D97u;
    return x ^ x >> 15;
}

float cln_uniform_hash(uint64_t seed, uint32_t stream, uint32_t step, uint32_t index,
                       uint32_t number, uint32_t draw)
{
    const uint32_t counter[4] = {0, stream << 24, step, 0};
    const uint32_t key[2] = {(uint32_t)seed, (uint32_t)(seed >> 32)};
    uint32_t words[4], own;

    cln_philox(counter, key, words);
    own = cln_hash(cln_hash(index ^ words[0]) + number);
    return (float)(cln_hash(own + (draw + 1) * 0x9E3779B9u) >> 8) * 0x1p-24f;
}
