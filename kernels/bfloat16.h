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

/* Stochastic rounding, right on average. chance: 16 random bits. */
HELPER vh bfloat16_by_chance(vf value, vu chance)
{
    return V_TO_USHORT((V_AS_UINT(value) + chance) >> 16);
}
