// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Generic;

namespace Lightprobe
{
    /// <summary>What the lines of proto/ranges.toml mean (Ranges.cs). May be called by any thread.</summary>
    internal static class RangeCheck
    {
        /// <summary>A number that is not there is not out of its range.</summary>
        internal static bool IsInside(double? value, double least, double most, double above) =>
            value == null || (value >= least && value <= most && value > above && !double.IsInfinity(value.Value));

        internal static bool Keeps(List<float> values, long count, double least, double most, double above, bool unit, bool absent, bool nan)
        {
            if (absent && values.Count == 0) return true;
            if (values.Count != count) return false;
            double square = 0;
            foreach (float value in values)
            {
                if (!(float.IsNaN(value) ? nan : IsInside(value, least, most, above))) return false;
                square += (double)value * value;
            }
            return !unit || Math.Abs(Math.Sqrt(square) - 1) <= Ranges.UnitTolerance;
        }
    }
}
