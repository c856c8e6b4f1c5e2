/* A rendered picture in memory. See picture.h. */
#include "render/picture.h"

#include <stdlib.h>
#include <string.h>

void cln_picture_free(cln_picture *picture)
{
    free(picture->rgb);
    free(picture->depth);
    free(picture->opacity);
    memset(picture, 0, sizeof *picture);
}
