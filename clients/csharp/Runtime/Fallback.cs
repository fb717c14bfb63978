// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Generic;
using Lightprobe.Messages;

namespace Lightprobe
{
    /// <summary>The light to show while there is none of a probe; the same in every client (docs/users/clients.md).</summary>
    public static class Fallback
    {
        /// <summary>Mean radiance before the first estimate: a white surface shows about half of full brightness.</summary>
        private const double Radiance = 0.5;
        /// <summary>How much brighter the upper side is than the middle, as a share.</summary>
        private const double FromAbove = 0.4;
        private static readonly double Y0 = Math.Sqrt(1 / (4 * Math.PI)), Y1 = Math.Sqrt(3 / (4 * Math.PI));

        /// <summary>
        /// A neutral, soft light from above, for before the first and after the last estimate: as bright in the mean as `last`.
        /// It has no lamps, because nobody knows where they are. Its BootId and Sequence are 0.
        /// </summary>
        /// <param name="last">The last estimate; null: none has come.</param>
        public static Estimate Estimate(Estimate last = null)
        {
            double mean = last == null ? Radiance : Math.Max(0, MeanIrradiance(last) / Math.PI);
            var sh = new SphericalHarmonics { Kind = SphericalHarmonicsKind.Ambient, Order = 1 };
            foreach (double value in new[] { mean / Y0, FromAbove * mean / Y1, 0, 0 })
                for (int c = 0; c < 3; c++) sh.Coefficients.Add((float)value);
            return new Estimate { Sh = sh, Flags = (uint)EstimateFlag.Stale, CdM2PerUnit = last?.CdM2PerUnit };
        }

        /// <summary>Mean of the luminance of E(n) over all normals n: π L for uniform radiance L.</summary>
        public static double MeanIrradiance(Estimate estimate)
        {
            double sum = estimate.Sh == null ? 0 : Math.PI * Y0 * Luminance(estimate.Sh.Coefficients);
            if (estimate.Sh != null && estimate.Sh.Kind == SphericalHarmonicsKind.Total) return sum; // lamps are in it
            foreach (Light lamp in estimate.Lights) sum += Luminance(lamp.Irradiance) / 4;
            return estimate.Key == null ? sum : sum + Luminance(estimate.Key.Irradiance) / 4;
        }

        private static double Luminance(IList<float> rgb) =>
            rgb.Count < 3 ? 0 : 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
    }
}
