/* bfloat16: the upper half of a float32, stored as ushort. */

HELPER float bfloat16_value(ushort bits)
{
    return as_float((uint)bits << 16);
}

HELPER vf bfloat16_values(vh bits)
{
    return V_AS_FLOAT(V_TO_UINT(bits) << 16);
}

/* Rounds to nearest, ties to even; a NaN stays NaN. */
HELPER ushort bfloat16_nearest(float value)
{
    const uint bits = as_uint(value);

    return (ushort)(isnan(value) ? 0x7FC0u : (bits + 0x7FFFu + (bits >> 16 & 1u)) >> 16);
}

/* Stochastic rounding, right on average; a NaN stays NaN. chance: 16 random bits. */
HELPER vh bfloat16_by_chance(vf value, vu chance)
{
    const vu rounded = (V_AS_UINT(value) + chance) >> 16;

    return V_TO_USHORT(select(rounded, (vu)(0x7FC0u), value != value));
}
