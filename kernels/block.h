/* needs: network fetch space encoding_frequency */
/* A block: up to NB samples of one leaf, which go through its network together, layer by layer, in
 * the work-group's local memory. Rows past the count hold garbage that affects no other row. */

typedef struct block {
    int count, tiles, rows; /* samples; tiles of TS; rows: whole tiles, rounded up to vectors */
    bool first, last;       /* of its slice */
    const __local uint *ids; /* [NB] -> sample */
    uint step_key;           /* of the slopes */
    int lid;
} block;

/* The block after `done` of `total` samples. */
HELPER block block_at(uint done, uint total, const __local uint *ids, uint step_key)
{
    const int count = (int)min((uint)NB, total - done), tiles = (count + TS - 1) / TS;
    const block b = {count,    tiles, (tiles * TS + VW - 1) / VW * VW,
                     done == 0u, total - done <= NB,
                     ids,      step_key, (int)get_local_id(0)};

    return b;
}

HELPER uint block_slope_key(block b, int s, int layer)
{
    return slope_key(b.step_key, b.ids[s], (uint)layer);
}

/* ---- its samples ---- */

/* Loads local positions at [3][NB] and directions along [3][NB] of the samples that this work-item
 * put into ids. */
HELPER void load_samples(block b, sample_source from, float4 box, __local float *at,
                         __local float *along)
{
    /* one kind of load at a time, so that many overlap */
    for (int s = b.lid; s < b.rows; s += LS) {
        const cln_sample sample = from.samples[b.ids[s]];

        at[s] = sample.t;
        /* as values: the bits of a small integer are a denormal float, which a device may flush */
        at[NB + s] = convert_float(sample.ray & 0xFFFFu);
        at[2 * NB + s] = convert_float(sample.ray >> 16);
    }
    for (int s = b.lid; s < b.rows; s += LS) {
        const uint ray = convert_uint(at[NB + s]) | convert_uint(at[2 * NB + s]) << 16;
        const float4 d = from.ray_d[ray];
        const float4 o = from.ray_o[ray];
        const float4 p = leaf_local(MAD((float4)(at[s]), d, o), box);

        at[s] = p.x;
        at[NB + s] = p.y;
        at[2 * NB + s] = p.z;
#if VIEW > 0
        const float3 view = view_direction(o, d, box);

        along[s] = view.x;
        along[NB + s] = view.y;
        along[2 * NB + s] = view.z;
#endif
    }
}
