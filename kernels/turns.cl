/* How far loops go, for the self-test: a driver may end long ones early and silently, as Mesa's
 * llvmpipe does after 65,535 turns of all loops of a kernel together.
 *
 *   out[0] = x_(n n), x_0 = 1, x_(i+1) = 1664525 x_i + 1013904223 (mod 2^32)
 */
__kernel void turns(__global uint *restrict out, uint n)
{
    uint x = 1u;

    for (uint i = 0; i < n; i++)
        for (uint k = 0; k < n; k++)
            x = x * 1664525u + 1013904223u;
    if (get_global_id(0) == 0)
        out[0] = x;
}
