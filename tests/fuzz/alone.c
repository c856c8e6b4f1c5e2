/* A main() for a fuzz target where there is no libFuzzer: reads every input of the given folders,
 * then changes of them, always the same ones. No coverage, no search: that is `make fuzz`.
 *
 *   TARGET -runs=N FOLDER...    N changes of each input */
#include <dirent.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes);

enum { MOST_BYTES = 1 << 20, MOST_EDITS = 6 };

static uint64_t state = 1;

static size_t draw(size_t below)
{
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (size_t)(state >> 33) % (below ? below : 1);
}

/* Changes a byte, removes, repeats or inserts a few, or cuts the end; the first byte, which may
 * choose a file, mostly stays. */
static size_t change(uint8_t *data, size_t bytes)
{
    static const uint8_t telling[] = "\0\xFF\x7F\x80\x01 09-+.eE,:;|=\"'{}[]()/*#%\n\\";
    const size_t at = bytes > 1 && draw(50) ? 1 + draw(bytes - 1) : 0, rest = bytes - at;
    const size_t length = 1 + draw(rest < 16 ? rest : 16);

    switch (draw(5)) {
    case 0:
        if (rest)
            data[at] = (uint8_t)draw(256);
        return bytes;
    case 1:
        if (rest)
            data[at] = telling[draw(sizeof telling - 1)];
        return bytes;
    case 2:
        if (length > rest)
            return bytes;
        memmove(data + at, data + at + length, rest - length);
        return bytes - length;
    case 3:
        if (length > rest || bytes + length > MOST_BYTES)
            return bytes;
        memmove(data + at + length, data + at, rest);
        return bytes + length;
    default:
        return draw(10) ? bytes : at;
    }
}

static void read_input(const char *path, int runs)
{
    static uint8_t original[MOST_BYTES];
    FILE *f = fopen(path, "rb");
    size_t bytes = f ? fread(original, 1, sizeof original, f) : 0;

    if (!f || ferror(f)) {
        perror(path);
        exit(2);
    }
    fclose(f);
    for (int run = 0; run <= runs; run++) {
        size_t changed = bytes;
        uint8_t *data = malloc(MOST_BYTES), *exact = NULL;

        if (!data)
            exit(2);
        memcpy(data, original, bytes);
        for (size_t edit = run ? 1 + draw(MOST_EDITS) : 0; edit > 0; edit--)
            changed = change(data, changed);
        exact = realloc(data, changed ? changed : 1); /* the sanitizer knows its end */
        LLVMFuzzerTestOneInput(exact ? exact : data, changed);
        free(exact ? exact : data);
    }
}

static int by_name(const struct dirent **a, const struct dirent **b)
{
    return strcmp((*a)->d_name, (*b)->d_name);
}

int main(int argc, char **argv)
{
    int runs = 0, inputs = 0;

    LLVMFuzzerInitialize(&argc, &argv);
    for (int i = 1; i < argc; i++) {
        struct dirent **entries = NULL;
        int count = 0;

        if (sscanf(argv[i], "-runs=%d", &runs) == 1)
            continue;
        count = scandir(argv[i], &entries, NULL, by_name);
        if (count < 0) {
            perror(argv[i]);
            return 2;
        }
        for (int k = 0; k < count; k++) {
            char path[4096];

            snprintf(path, sizeof path, "%s/%s", argv[i], entries[k]->d_name);
            if (entries[k]->d_name[0] != '.') {
                read_input(path, runs);
                inputs++;
            }
            free(entries[k]);
        }
        free(entries);
    }
    printf("%d inputs, %d changes of each\n", inputs, runs);
    return inputs ? 0 : 2;
}
