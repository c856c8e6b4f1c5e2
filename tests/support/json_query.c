/* build/json-query: a value of a JSON document, for the shell tests; Debian has no such tool by
 * default.
 *
 *   json-query PATH < DOCUMENT     the value at PATH: "mean.psnr", "images.0.name", or "." for all
 *   json-query -l PATH < LINES     the same for each line of a JSON-lines file
 *
 * Texts are printed bare, numbers in full, others as "array N" or "object N". Exit code 1, with the
 * reason on stderr, if the input is not one JSON document (per line) or has nothing at PATH. */
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const json_t *at_path(const json_t *value, const char *path)
{
    char key[256];

    while (value && *path && strcmp(path, ".")) {
        size_t length = strcspn(path, ".");
        if (length >= sizeof key)
            return NULL;
        memcpy(key, path, length);
        key[length] = 0;
        path += length + (path[length] == '.');
        value = json_is_array(value) ? json_array_get(value, (size_t)strtoul(key, NULL, 10))
                                     : json_object_get(value, key);
    }
    return value;
}

static void print(const json_t *value)
{
    switch (json_typeof(value)) {
    case JSON_OBJECT:
        printf("object %zu\n", json_object_size(value));
        break;
    case JSON_ARRAY:
        printf("array %zu\n", json_array_size(value));
        break;
    case JSON_STRING:
        printf("%s\n", json_string_value(value));
        break;
    case JSON_INTEGER:
        printf("%lld\n", (long long)json_integer_value(value));
        break;
    case JSON_REAL:
        printf("%.17g\n", json_real_value(value));
        break;
    case JSON_TRUE:
    case JSON_FALSE:
        puts(json_is_true(value) ? "true" : "false");
        break;
    case JSON_NULL:
        puts("null");
        break;
    }
}

static int query(json_t *document, const json_error_t *error, const char *path)
{
    const json_t *value = at_path(document, path);

    if (!document)
        fprintf(stderr, "json-query: line %d column %d: %s\n", error->line, error->column,
                error->text);
    else if (!value)
        fprintf(stderr, "json-query: nothing at %s\n", path);
    else
        print(value);
    json_decref(document);
    return value ? 0 : 1;
}

int main(int argc, char **argv)
{
    json_error_t error = {0};
    char *line = NULL;
    size_t size = 0;
    int rc = 0;

    if (argc == 2)
        return query(json_loadf(stdin, JSON_DECODE_ANY, &error), &error, argv[1]);
    if (argc != 3 || strcmp(argv[1], "-l")) {
        fputs("usage: json-query [-l] PATH\n", stderr);
        return 2;
    }
    while (!rc && getline(&line, &size, stdin) >= 0)
        rc = query(json_loads(line, JSON_DECODE_ANY, &error), &error, argv[2]);
    free(line);
    return rc;
}
