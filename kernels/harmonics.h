/* needs: lanes */
/* Real spherical harmonics of a unit direction, over the constant one (Sloan, "Efficient Spherical
 * Harmonic Evaluation", JCGT 2(2), 2013; twin: host/reference/voxel.c). */

/* y[k * step], k < count: count 1, 4 or 9 for degrees 0, 1 and 2. */
HELPER void harmonics_of(float3 d, int count, int step, float *y)
{
    y[0] = 1.0f;
    if (count > 1) {
        y[step] = 1.7320508f * d.y;
        y[2 * step] = 1.7320508f * d.z;
        y[3 * step] = 1.7320508f * d.x;
    }
    if (count > 4) {
        y[4 * step] = 3.8729833f * d.x * d.y;
        y[5 * step] = 3.8729833f * d.y * d.z;
        y[6 * step] = 1.1180340f * (3.0f * d.z * d.z - 1.0f);
        y[7 * step] = 3.8729833f * d.x * d.z;
        y[8 * step] = 1.9364917f * (d.x * d.x - d.y * d.y);
    }
}
