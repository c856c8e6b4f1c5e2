/* See colour.h. */
#include "io/colour.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "base/files.h"
#include "base/memory.h"

#ifdef CLN_WITH_LCMS2
#include <lcms2.h>

enum { PROFILE_MOST = 1 << 24, NEAR = 2 /* of 255 */ };

/* Puts the parts of a profile together; *profile NULL: there is none, or not all of it. */
static cln_status assemble(const cln_colour_mark *mark, uint8_t **profile, size_t *bytes)
{
    cln_status st = CLN_OK;
    uint8_t *out = NULL;

    *profile = NULL;
    *bytes = 0;
    for (int i = 1; i <= mark->parts; i++) {
        if (!mark->part[i].at)
            return CLN_OK;
        *bytes += mark->part[i].bytes;
    }
    if (mark->parts == 0 || *bytes == 0)
        return CLN_OK;
    if (mark->deflated) { /* its length is not told */
        uLongf room = 16 * mark->part[1].bytes + 4096;
        int status = Z_BUF_ERROR;

        for (; status == Z_BUF_ERROR && room <= PROFILE_MOST; room *= 4) {
            free(out);
            CLN_TRY(cln_alloc(&out, room, 1, "colour profile"));
            *bytes = room;
            status = uncompress(out, (uLongf *)bytes, mark->part[1].at, mark->part[1].bytes);
        }
        if (status != Z_OK)
            goto done;
    } else {
        size_t at = 0;

        CLN_TRY(cln_alloc(&out, *bytes, 1, "colour profile"));
        for (int i = 1; i <= mark->parts; i++) {
            memcpy(out + at, mark->part[i].at, mark->part[i].bytes);
            at += mark->part[i].bytes;
        }
    }
    *profile = out;
    out = NULL;
done:
    free(out);
    return st;
}

/* Nearly all that write a gamma of 1 / 2.2 beside sRGB's primaries mean sRGB's curve. */
static bool other_gamma(const cln_colour_mark *mark)
{
    return mark->gamma > 0 && fabs(mark->gamma * 2.2 - 1) > 0.05;
}

static bool other_chroma(const cln_colour_mark *mark)
{
    static const double srgb[8] = {0.3127, 0.329, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06};
    bool other = false;

    for (int i = 0; i < 8 && mark->chroma[0] > 0; i++)
        other |= fabs(mark->chroma[i] - srgb[i]) > 0.01;
    return other;
}

static bool says_chunks(const cln_colour_mark *mark)
{
    return !mark->srgb && (other_gamma(mark) || other_chroma(mark));
}

/* Of gAMA and cHRM. */
static cmsHPROFILE of_chunks(const cln_colour_mark *mark)
{
    const bool power = mark->gamma > 0 && (other_gamma(mark) || other_chroma(mark));
    const double *c = mark->chroma;
    const double srgb[5] = {2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045};
    cmsCIExyY white = {0.3127, 0.329, 1};
    cmsCIExyYTRIPLE primaries = {{0.64, 0.33, 1}, {0.3, 0.6, 1}, {0.15, 0.06, 1}};
    cmsToneCurve *curve =
        power ? cmsBuildGamma(NULL, 1 / mark->gamma) : cmsBuildParametricToneCurve(NULL, 4, srgb);
    cmsToneCurve *const curves[3] = {curve, curve, curve};
    cmsHPROFILE profile = NULL;

    if (c[0] > 0) {
        white = (cmsCIExyY){c[0], c[1], 1};
        primaries = (cmsCIExyYTRIPLE){{c[2], c[3], 1}, {c[4], c[5], 1}, {c[6], c[7], 1}};
    }
    profile = curve ? cmsCreateRGBProfile(&white, &primaries, curves) : NULL;
    cmsFreeToneCurve(curve);
    return profile;
}

/* Adobe RGB (1998): its annex has white, primaries and exponent. */
static cmsHPROFILE of_adobe(void)
{
    const cln_colour_mark adobe = {.gamma = 256.0 / 563,
                                   .chroma = {0.3127, 0.329, 0.64, 0.33, 0.21, 0.71, 0.15, 0.06}};

    return of_chunks(&adobe);
}

/* *profile NULL: nothing is said, or nothing that can be used (*unknown). */
static cln_status open_profile(const cln_colour_mark *mark, cmsHPROFILE *profile, bool *unknown)
{
    cln_status st = CLN_OK;
    uint8_t *data = NULL;
    size_t bytes = 0;

    *profile = NULL;
    *unknown = false;
    if (mark->parts > 0) {
        CLN_TRY(assemble(mark, &data, &bytes));
        if (data && bytes <= UINT32_MAX)
            *profile = cmsOpenProfileFromMem(data, (cmsUInt32Number)bytes);
        *unknown = !*profile || cmsGetColorSpace(*profile) != cmsSigRgbData;
        if (*profile && *unknown) {
            cmsCloseProfile(*profile);
            *profile = NULL;
        }
    } else if (says_chunks(mark)) {
        *profile = of_chunks(mark);
        *unknown = !*profile;
    } else if (mark->adobe) {
        *profile = of_adobe();
        *unknown = !*profile;
    }
done:
    free(data);
    return st;
}

static cmsHTRANSFORM to_srgb(cmsHPROFILE from, int channels, bool deep)
{
    /* of 16 bits Little CMS would interpolate between few colours, which is off by 10 of 255 */
    const cmsUInt32Number flags =
        (channels == 4 ? cmsFLAGS_COPY_ALPHA : 0) | (deep ? cmsFLAGS_NOOPTIMIZE : 0);
    const cmsUInt32Number in = deep ? (channels == 4 ? TYPE_RGBA_16 : TYPE_RGB_16)
                                    : (channels == 4 ? TYPE_RGBA_8 : TYPE_RGB_8);
    cmsHPROFILE srgb = cmsCreate_sRGBProfile();
    cmsHTRANSFORM out =
        srgb ? cmsCreateTransform(from, in, srgb, channels == 4 ? TYPE_RGBA_8 : TYPE_RGB_8,
                                  INTENT_PERCEPTUAL, flags)
             : NULL;

    if (srgb)
        cmsCloseProfile(srgb);
    return out;
}

/* Does a transform leave colours as they are? */
static bool keeps(cmsHTRANSFORM transform)
{
    enum { STEPS = 9 };
    uint8_t in[STEPS * STEPS * STEPS][3], out[STEPS * STEPS * STEPS][3];
    bool near = true;

    for (int i = 0; i < STEPS * STEPS * STEPS; i++) {
        in[i][0] = (uint8_t)(i % STEPS * 255 / (STEPS - 1));
        in[i][1] = (uint8_t)(i / STEPS % STEPS * 255 / (STEPS - 1));
        in[i][2] = (uint8_t)(i / STEPS / STEPS * 255 / (STEPS - 1));
    }
    cmsDoTransform(transform, in, out, STEPS * STEPS * STEPS);
    for (int i = 0; i < STEPS * STEPS * STEPS; i++)
        for (int c = 0; c < 3; c++)
            near &= abs(in[i][c] - out[i][c]) <= NEAR;
    return near;
}

/* What the mark says, as one number. */
static uint64_t digest_of(const cln_colour_mark *mark)
{
    uint64_t d = CLN_DIGEST_START;

    for (int i = 1; i <= mark->parts; i++)
        if (mark->part[i].at)
            d = cln_digest(d, mark->part[i].at, mark->part[i].bytes);
    d = cln_digest(d, &mark->parts, sizeof mark->parts);
    d = cln_digest(d, &mark->srgb, sizeof mark->srgb);
    d = cln_digest(d, &mark->adobe, sizeof mark->adobe);
    d = cln_digest(d, &mark->gamma, sizeof mark->gamma);
    return cln_digest(d, mark->chroma, sizeof mark->chroma);
}

static cln_colour_kind find_kind(const cln_colour_mark *mark, char name[CLN_COLOUR_NAME])
{
    cmsHPROFILE profile = NULL;
    cmsHTRANSFORM transform = NULL;
    bool unknown = false;
    cln_colour_kind kind = CLN_COLOUR_SRGB;

    if (open_profile(mark, &profile, &unknown) != CLN_OK) {
        cln_clear_error();
        return CLN_COLOUR_UNKNOWN;
    }
    if (!profile)
        return unknown ? CLN_COLOUR_UNKNOWN : CLN_COLOUR_SRGB;
    if (mark->parts > 0)
        cmsGetProfileInfoASCII(profile, cmsInfoDescription, "en", "US", name, CLN_COLOUR_NAME);
    else
        snprintf(name, CLN_COLOUR_NAME, "%s",
                 mark->adobe ? "Adobe RGB by EXIF data" : "a PNG's gamma and primaries");
    name[CLN_COLOUR_NAME - 1] = 0;
    for (char *c = name; *c; c++)
        if (*c < ' ' || *c > '~')
            *c = '?';
    transform = to_srgb(profile, 3, false);
    kind = !transform ? CLN_COLOUR_UNKNOWN : keeps(transform) ? CLN_COLOUR_SRGB : CLN_COLOUR_OTHER;
    if (transform)
        cmsDeleteTransform(transform);
    cmsCloseProfile(profile);
    return kind;
}

cln_colour_kind cln_colour_of(const cln_colour_mark *mark, char name[CLN_COLOUR_NAME])
{
    static _Thread_local struct {
        bool known;
        uint64_t digest;
        cln_colour_kind kind;
        char name[CLN_COLOUR_NAME];
    } last;
    uint64_t digest = 0;

    name[0] = 0;
    if (mark->parts == 0 && !says_chunks(mark) && !mark->adobe)
        return CLN_COLOUR_SRGB;
    digest = digest_of(mark);
    if (!last.known || last.digest != digest) {
        last.name[0] = 0;
        last.kind = find_kind(mark, last.name);
        last.digest = digest;
        last.known = true;
    }
    memcpy(name, last.name, CLN_COLOUR_NAME);
    return last.kind;
}

cln_status cln_colour_convert(const cln_colour_mark *mark, size_t count, int channels, bool deep,
                              const void *in, uint8_t *out, bool *done)
{
    const size_t some = 1 << 20, each = (size_t)channels * (deep ? 2 : 1);
    cln_status st = CLN_OK;
    cmsHPROFILE profile = NULL;
    cmsHTRANSFORM transform = NULL;
    char name[CLN_COLOUR_NAME];
    bool unknown = false;

    *done = false;
    if (cln_colour_of(mark, name) != CLN_COLOUR_OTHER)
        return CLN_OK;
    CLN_TRY(open_profile(mark, &profile, &unknown));
    transform = profile ? to_srgb(profile, channels, deep) : NULL;
    if (!transform)
        CLN_TRY(cln_fail(CLN_MEMORY, "no memory to convert colours of '%s'", name));
    for (size_t first = 0; first < count; first += some) {
        const size_t n = count - first < some ? count - first : some;

        cmsDoTransform(transform, (const uint8_t *)in + first * each,
                       out + first * (size_t)channels, (cmsUInt32Number)n);
    }
    *done = true;
done:
    if (transform)
        cmsDeleteTransform(transform);
    if (profile)
        cmsCloseProfile(profile);
    return st;
}

const char *cln_colour_unknown_reason(void)
{
    return "it is damaged, or not of red, green and blue";
}

#else

const char *cln_colour_unknown_reason(void)
{
    return "this program was built without Little CMS, Debian's package liblcms2-dev";
}

cln_colour_kind cln_colour_of(const cln_colour_mark *mark, char name[CLN_COLOUR_NAME])
{
    name[0] = 0;
    return mark->parts > 0 || mark->adobe ? CLN_COLOUR_UNKNOWN : CLN_COLOUR_SRGB;
}

cln_status cln_colour_convert(const cln_colour_mark *mark, size_t count, int channels, bool deep,
                              const void *in, uint8_t *out, bool *done)
{
    (void)mark, (void)count, (void)channels, (void)deep, (void)in, (void)out;
    *done = false;
    return CLN_OK;
}

#endif
