/* Picture quality (method.md section 14): the one routine for every PSNR and SSIM the program
 * prints. PSNR = -10 log10(MSE over pixels and channels), values clipped to [0,1]. SSIM: 11x11
 * Gaussian window, sigma 1.5, K1 0.01, K2 0.03, L = 1, valid convolution, per channel, mean of the
 * map, variances clipped at 0 and |s01| <= sqrt(s00 s11). All sums in double.
 *
 * Where pixels are left out, the MSE is over the others, and SSIM over windows that have none of
 * them. */
#ifndef CLN_METRICS_IMAGE_H
#define CLN_METRICS_IMAGE_H

#include <stdbool.h>
#include <stdint.h>
#include "base/status.h"

/* a, b: [height][width][3] float; kept: [height][width], 0 where a pixel is left out, or NULL. MSE
 * of equal images is 0, their PSNR is reported as 100 dB. */
double cln_image_mse(int width, int height, const uint8_t *kept, const float *a, const float *b);
double cln_psnr(double mse);
/* The MSE after the affine map of a's colours (3 x 3 matrix and offset) that brings them nearest to
 * b's by least squares: what is left where two photos differ in exposure and white balance. Never
 * above cln_image_mse but for the clipping to [0,1]; a NaN stays a NaN. */
double cln_image_fitted_mse(int width, int height, const uint8_t *kept, const float *a,
                            const float *b);
/* The same of the given share of the pixels that count, those that differ least. CLN_MEMORY. */
cln_status cln_image_most_mse(int width, int height, const uint8_t *kept, const float *a,
                              const float *b, double share, double *mse);
enum { CLN_SSIM_WINDOW = 11 };
/* NAN if no window is whole. CLN_INPUT if a side is under that many pixels. */
cln_status cln_image_ssim(int width, int height, const uint8_t *kept, const float *a,
                          const float *b, double *ssim);
/* Whether any window is whole, of an image that is large enough. */
cln_status cln_ssim_has_window(int width, int height, const uint8_t *kept, bool *has);

#endif
