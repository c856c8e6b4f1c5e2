/* Arrays with a row per leaf, and gradients, with a row per slice. If one would exceed the device's
 * largest allocation, they are in PARTS buffers: row r is in part r / each, at r % each. OpenCL
 * allows at least a quarter of the memory in one buffer, so four parts reach all of it.
 *
 *   LEAF_ARRAY(type, name)          a kernel's or helper's parameter, PARTS pointers
 *   LEAF_PASS(name)                 the same as arguments of a helper
 *   LEAF_ROW(name, leaf, row)       pointer to a leaf's row; row: elements of a row
 *   SLICE_ROW(name, slice, row)     pointer to a slice's gradient
 *   LEAF_ELEMENT(name, index, row)  element `index` of the whole array
 *
 * PARTS        1 | 4
 * PART_LEAVES, PART_SLICES  rows of a part, if there are four
 */
#ifndef PARTS
#define PARTS 1
#endif
#ifndef PART_LEAVES
#define PART_LEAVES 3u
#define PART_SLICES 5u
#endif

#if PARTS == 1
#define LEAF_ARRAY(type, name)         __global type *restrict name
#define LEAF_PASS(name)                name
#define PART_ROW(name, r, each, row)   ((name) + (size_t)(r) * (row))
#define LEAF_ELEMENT(name, index, row) (name[index])
#else
#define LEAF_ARRAY(type, name)                                           \
    __global type *restrict name##_0, __global type *restrict name##_1, \
        __global type *restrict name##_2, __global type *restrict name##_3
#define LEAF_PASS(name) name##_0, name##_1, name##_2, name##_3
#define PART_ROW(name, r, each, row)                                                  \
    (((uint)(r) < 2u * (each) ? (uint)(r) < (each) ? name##_0 : name##_1              \
                              : (uint)(r) < 3u * (each) ? name##_2 : name##_3) +      \
     (size_t)((uint)(r) % (each)) * (row))
#define LEAF_ELEMENT(name, index, row) (LEAF_ROW(name, (index) / (row), row)[(index) % (row)])
#endif
#define LEAF_ROW(name, leaf, row)   PART_ROW(name, leaf, PART_LEAVES, row)
#define SLICE_ROW(name, slice, row) PART_ROW(name, slice, PART_SLICES, row)
