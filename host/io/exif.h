/* What EXIF data say of an image's orientation, focal length, colours and place. */
#ifndef CLN_EXIF_H
#define CLN_EXIF_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* orientation: 1 to 8, how viewers turn the stored picture (3: by half a turn; 6 and 8: by a
 * quarter turn, clockwise and back; 2, 4, 5, 7 also mirror it); 1 if it is not told. focal: the
 * lens's own, mm; focal_film: that of the same view on 35 mm film; each 0 if it is not told. zoom:
 * how many times the picture was cut and enlarged, 1 if it is not told. adobe: colours are Adobe
 * RGB's, unless a profile in the file says something else. gps: latitude and longitude, degrees
 * north and east by WGS 84, and altitude, metres; each NAN if it is not told, and both degrees
 * where they are 0, as devices without reception write. */
typedef struct cln_exif {
    int orientation;
    double focal, focal_film, zoom;
    bool adobe;
    double gps[3];
} cln_exif;

/* Of the contents of an APP1 segment. What they do not say, or is damaged, is 1, zeros and NAN. */
cln_exif cln_exif_read(const uint8_t *data, size_t bytes);

/* The same of the TIFF file in it, which is all of a PNG's eXIf chunk. */
cln_exif cln_exif_read_tiff(const uint8_t *tiff, size_t bytes);

#endif
