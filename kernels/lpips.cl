/* The layers of LPIPS (host/render/lpips.h): convolutions, pools, and the comparison of two
 * pictures' features. Features are [row][channel][column], as what a sum takes then lies on few
 * pages, with a border of zeros; `row` and `line` are the floats of a row and of a channel's part
 * of it, `border` the rows and columns of zeros.
 *
 *   lpips_convolve   out[n][y][x] = max(0, b[n] + sum in[k][s y + v][s x + u] w[n][k][v][u])
 *   lpips_pool       out[n][y][x] = max in[n][2 y + v][2 x + u]
 *   lpips_compare    out[y][x] = sum_n lin[n] (a[n]/|a| - b[n]/|b|)^2, |a| over the channels
 *
 *   VW   floats of a vector (lanes.h), along a row
 *   LS   work-items of a convolution's group, along a row
 */
#ifndef LS
#define LS 1
#endif
#pragma OPENCL FP_CONTRACT OFF /* pictures that are alike differ by 0 */
#define NT 4 /* channels, and */
#define XV 3 /* vectors of a row, that a work-item keeps sums of */

/* s = stride: a line has its columns x by x % s, those of one remainder are one part. A
 * group makes NT channels of LS XV VW pixels; groups that follow each other make other channels of
 * the same pixels, whose inputs caches keep. */
__kernel __attribute__((reqd_work_group_size(LS, 1, 1))) void
lpips_convolve(const __global float *restrict in,
               const __global float *restrict w,    /* [n / NT][k][v][u][NT] */
               const __global float *restrict bias, /* [n] */
               __global float *restrict out, uint channels, uint inputs, uint size, uint stride,
               uint row, uint line, uint width, uint height, uint out_row, uint out_line,
               uint border)
{
    const uint blocks = channels / NT, n = get_group_id(0) % blocks * NT;
    const uint tiles = (width + LS * XV * VW - 1) / (LS * XV * VW);
    const uint tile = get_group_id(0) / blocks % tiles, y = get_group_id(0) / blocks / tiles;
    const uint x = tile * (LS * XV * VW) + get_local_id(0) * VW, part = line / stride;
    const __global float *weights = w + (size_t)n * inputs * size * size;
    vf sums[NT][XV];

    if (y >= height)
        return;
    UNROLL (i, NT)
        UNROLL (j, XV)
            sums[i][j] = (vf)(bias[n + i]);
    for (uint k = 0; k < inputs; k++)
        for (uint v = 0; v < size; v++) {
            const __global float *at = in + (size_t)(y * stride + v) * row + k * line + x;
            uint turn = 0; /* u % stride */

            for (uint u = 0; u < size; u++, weights += NT) {
                vf values[XV];

                UNROLL (j, XV)
                    values[j] = VLOAD(at + j * LS * VW);
                UNROLL (i, NT)
                    UNROLL (j, XV)
                        sums[i][j] = MAD((vf)(weights[i]), values[j], sums[i][j]);
                at += ++turn < stride ? (int)part : 1 - (int)((stride - 1) * part);
                turn = turn < stride ? turn : 0;
            }
        }
    UNROLL (i, NT)
        UNROLL (j, XV) {
            const uint first = x + j * LS * VW;
            __global float *to = out + (size_t)(y + border) * out_row + (n + i) * out_line +
                                 border + first;
            float lanes[VW];

            if (first + VW <= width) {
                VSTORE_IN(__global, fmax(sums[i][j], (vf)(0.0f)), to);
            } else {
                VSTORE(fmax(sums[i][j], (vf)(0.0f)), lanes);
                for (uint l = 0; first + l < width; l++)
                    to[l] = lanes[l];
            }
        }
}

/* Of features without a border; a work-item takes a pixel. */
__kernel void lpips_pool(const __global float *restrict in, __global float *restrict out,
                         uint channels, uint size, uint row, uint line, uint width, uint height,
                         uint out_row, uint out_line, uint border)
{
    const uint x = get_global_id(0) % width, y = get_global_id(0) / width % height;
    const uint n = get_global_id(0) / width / height;
    float most = 0.0f; /* rectified */

    if (n >= channels)
        return;
    for (uint v = 0; v < size; v++)
        for (uint u = 0; u < size; u++)
            most = fmax(most, in[(size_t)(2 * y + v) * row + n * line + 2 * x + u]);
    out[(size_t)(y + border) * out_row + n * out_line + border + x] = most;
}

/* A work-item takes a pixel. */
__kernel void lpips_compare(const __global float *restrict a, const __global float *restrict b,
                            const __global float *restrict lin, /* [n] */
                            __global float *restrict out, uint channels, uint row, uint line,
                            uint width, uint height, uint border)
{
    const uint x = get_global_id(0) % width, y = get_global_id(0) / width;
    const size_t at = (size_t)(y + border) * row + border + x;
    float length_a = 0.0f, length_b = 0.0f, sum = 0.0f;

    if (y >= height)
        return;
    for (uint n = 0; n < channels; n++) {
        const float p = a[n * line + at], q = b[n * line + at];

        length_a += p * p;
        length_b += q * q;
    }
    length_a = 1.0f / (sqrt(length_a) + 1e-10f);
    length_b = 1.0f / (sqrt(length_b) + 1e-10f);
    for (uint n = 0; n < channels; n++) {
        const float p = a[n * line + at] * length_a;
        const float q = b[n * line + at] * length_b;
        const float d = p - q;

        sum += lin[n] * (d * d);
    }
    out[get_global_id(0)] = sum;
}
