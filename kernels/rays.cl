/* needs: space */
/* Pixels to rays: origin and unit direction in normalised space, through the pixel's centre
 * (camera.h has the model). The lens is inverted per ray; images are not undistorted beforehand.
 *
 *   AVERAGED 0 | 1   a ray goes through its spot of the pixel (CLN_SPOT) */
#ifndef AVERAGED
#define AVERAGED 1
#endif

__kernel void rays_make(const __global cln_device_camera *restrict cameras, /* [view] */
                        const __global cln_pixel *restrict pixels,         /* [ray] */
                        /* [ray], [ray][CLN_LINE_ROWS] in a shell space: for ray_depth() */
                        __global float4 *restrict ray_o, __global float4 *restrict ray_d,
                        uint n)
{
    const uint r = get_global_id(0);

    if (r >= n)
        return;
    const cln_pixel pixel = pixels[r];
    const cln_device_camera camera = cameras[pixel.view];
    float2 at = (float2)(convert_float(pixel.x) + 0.5f, convert_float(pixel.y) + 0.5f);
    float4 o, d;

#if AVERAGED
    at += (float2)(convert_float(CLN_SPOT_X(pixel.spot)), convert_float(CLN_SPOT_Y(pixel.spot))) *
          (1.0f / 4096.0f);
#endif
    const bool found = pixel_ray(camera, at.x, at.y, &o, &d);

    if (!found) {
        o = (float4)(3.0f, 3.0f, 3.0f, 0.0f); /* outside the cube, and away from it: sees nothing */
        d = (float4)(1.0f, 0.0f, 0.0f, 0.0f);
    }
#if SHELL
    shell_lines(found, o, d, ray_o + r * CLN_LINE_ROWS, ray_d + r * CLN_LINE_ROWS);
#else
    ray_o[r] = o;
    ray_d[r] = d;
#endif
}
