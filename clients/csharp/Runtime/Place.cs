// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Generic;
using Lightprobe.Messages;

namespace Lightprobe
{
    /// <summary>
    /// Light beside the probe: lamps re-aimed and re-scaled, ambient light moved through the room (docs/users/conventions.md, "Light at
    /// a place"; lightprobe.place is the same in Python). What is not known stays as the probe sees it, and says so: sigmas are null where nothing bounds the change.
    /// </summary>
    public static class Place
    {
        private const double Deg = Math.PI / 180;

        /// <summary>Relative change of a lamp's light with the angle at which it leaves the lamp, 1 sigma for each radian.</summary>
        private const double EmissionChangePerRad = 0.6;

        /// <summary>A lamp as it is seen from a place. The lamp itself stays as it is.</summary>
        /// <param name="lamp">A lamp of an estimate.</param>
        /// <param name="x">Metres from the probe, axes of the estimate's frame (right-handed, as on the wire).</param>
        /// <param name="y">Likewise.</param>
        /// <param name="z">Likewise.</param>
        public static Light At(Light lamp, double x, double y, double z)
        {
            Light there = Copy(lamp);
            double awayM = Math.Sqrt(x * x + y * y + z * z);
            if (awayM == 0) return there;
            there.ShadowStrengthPermille = null; // a share of all the light there, which a lamp alone does not tell
            if (lamp.DistanceM == null) return Far(lamp, there, awayM);
            double distanceM = lamp.DistanceM.Value;
            List<float> d = lamp.Direction;
            double u = distanceM * d[0] - x, v = distanceM * d[1] - y, w = distanceM * d[2] - z;
            double wayM = Math.Sqrt(u * u + v * v + w * w);
            // A lamp is a ball; a place within it is taken to be on it.
            double ballM = distanceM * Math.Sin(Math.Min(lamp.AngularRadiusDeg, 90) * Deg);
            double fromThereM = Math.Max(Math.Max(wayM, ballM), 1e-6);
            if (wayM > 0) Fill(there.Direction, u / wayM, v / wayM, w / wayM);
            double nearer = distanceM / fromThereM;
            double along = there.Direction[0] * (double)d[0] + there.Direction[1] * (double)d[1] + there.Direction[2] * (double)d[2];
            double across = Math.Sqrt(Math.Max(0, 1 - along * along));
            double? relative = lamp.DistanceSigmaPermille / 1000.0;
            for (int c = 0; c < 3; c++) there.Irradiance[c] = (float)(lamp.Irradiance[c] * nearer * nearer);
            there.AngularRadiusDeg = (float)(Math.Asin(Math.Min(1, ballM / fromThereM)) / Deg);
            there.DistanceM = (float)fromThereM;
            there.DistanceSigmaPermille = Permille(relative * nearer * Math.Abs(along));
            there.DirectionSigmaDeg = (float?)Both(lamp.DirectionSigmaDeg * nearer, relative * nearer * across / Math.Sqrt(2) / Deg);
            there.IrradianceSigmaPermille = Permille(Both(
                lamp.IrradianceSigmaPermille / 1000.0,
                Both(2 * relative * Math.Abs(1 - nearer * along), EmissionChangePerRad * Math.Acos(Math.Max(-1, Math.Min(1, along))))));
            for (int i = 0; i < there.HalfAngleDeg.Count; i++)
                there.HalfAngleDeg[i] = (float)(Math.Atan(nearer * Math.Tan(Math.Min(lamp.HalfAngleDeg[i], 89) * Deg)) / Deg);
            if (there.Axis.Count == 3) TurnAcross(there.Axis, there.Direction);
            return there;
        }

        /// <summary>
        /// The lamps of an estimate as they are seen from a place, strongest first. Add them to the SH there
        /// (<see cref="Ambient"/>). How dark their shadows are there (ShadowStrengthPermille) is null, but at the probe itself.
        /// </summary>
        /// <exception cref="ArgumentException">Its SH are TOTAL, which have the lamps in them; or the place is no number.</exception>
        public static List<Light> Lights(Estimate estimate, double x, double y, double z)
        {
            Check(estimate, x, y, z);
            var there = new List<Light>();
            foreach (Light lamp in estimate.Lights) there.Add(At(lamp, x, y, z));
            there.Sort((a, b) => Luminance(b.Irradiance).CompareTo(Luminance(a.Irradiance)));
            return there;
        }

        /// <summary>
        /// The SH of an estimate as they are at a place: moved through the room where it is known (Estimate.Room; best with
        /// Subscription.ShOrder 4), else as at the probe. They are of your own: change them as you like.
        /// </summary>
        /// <exception cref="ArgumentException">Its SH are TOTAL, which have the lamps in them; or the place is no number.</exception>
        public static SphericalHarmonics Ambient(Estimate estimate, double x, double y, double z)
        {
            Check(estimate, x, y, z);
            if (estimate.Sh == null) return null;
            SphericalHarmonics here = estimate.Sh;
            var there = new SphericalHarmonics { Kind = here.Kind, Order = here.Order, Basis = here.Basis, Quantity = here.Quantity };
            if (estimate.Room == null || (x == 0 && y == 0 && z == 0)) there.Coefficients.AddRange(here.Coefficients);
            else AmbientBox.Move(here.Coefficients, estimate.Room, x, y, z, there.Coefficients);
            return there;
        }

        private static void Check(Estimate estimate, double x, double y, double z)
        {
            if (double.IsNaN(x + y + z) || double.IsInfinity(x + y + z))
                throw new ArgumentException("estimate: at: expected x, y, z in metres");
            if (estimate.Sh != null && estimate.Sh.Kind == SphericalHarmonicsKind.Total)
                throw new ArgumentException("estimate: at: lamps are in the SH: subscribe to AMBIENT");
        }

        /// <summary>A lamp without distance: its sigmas hold what the nearest distance, at 3 sigma, allows, or are null.</summary>
        private static Light Far(Light lamp, Light there, double awayM)
        {
            if (lamp.NearestM == null || lamp.NearestM <= 3 * awayM)
            {
                there.DirectionSigmaDeg = null;
                there.IrradianceSigmaPermille = null;
                return there;
            }
            double share = awayM / lamp.NearestM.Value / 3;
            there.NearestM = (float)(lamp.NearestM.Value - awayM);
            there.DirectionSigmaDeg = (float?)Both(lamp.DirectionSigmaDeg, share / Deg);
            there.IrradianceSigmaPermille = Permille(Both(lamp.IrradianceSigmaPermille / 1000.0, 2 * share));
            return there;
        }

        /// <summary>Leave of an axis what lies across the direction, as a unit vector.</summary>
        private static void TurnAcross(List<float> axis, List<float> direction)
        {
            double along = axis[0] * (double)direction[0] + axis[1] * (double)direction[1] + axis[2] * (double)direction[2];
            double u = axis[0] - along * direction[0], v = axis[1] - along * direction[1], w = axis[2] - along * direction[2];
            double length = Math.Sqrt(u * u + v * v + w * w);
            if (length > 1e-6) Fill(axis, u / length, v / length, w / length);
        }

        private static Light Copy(Light lamp)
        {
            var copy = new Light
            {
                Id = lamp.Id, AngularRadiusDeg = lamp.AngularRadiusDeg, DirectionSigmaDeg = lamp.DirectionSigmaDeg,
                IrradianceSigmaPermille = lamp.IrradianceSigmaPermille, Flags = lamp.Flags, DistanceM = lamp.DistanceM,
                DistanceSigmaPermille = lamp.DistanceSigmaPermille, NearestM = lamp.NearestM, DolpPercent = lamp.DolpPercent,
                DolpSigmaPermille = lamp.DolpSigmaPermille, AolpDeg = lamp.AolpDeg, AolpSigmaDeg = lamp.AolpSigmaDeg,
                ReflectionPercent = lamp.ReflectionPercent, ColourSigmaPermille = lamp.ColourSigmaPermille,
                ShadowStrengthPermille = lamp.ShadowStrengthPermille,
            };
            copy.Direction.AddRange(lamp.Direction);
            copy.Irradiance.AddRange(lamp.Irradiance);
            copy.HalfAngleDeg.AddRange(lamp.HalfAngleDeg);
            copy.Axis.AddRange(lamp.Axis);
            return copy;
        }

        private static void Fill(List<float> vector, double x, double y, double z)
        {
            vector[0] = (float)x;
            vector[1] = (float)y;
            vector[2] = (float)z;
        }

        private static double? Both(double? a, double? b) => a == null || b == null ? null : (double?)Math.Sqrt(a.Value * a.Value + b.Value * b.Value);

        private static uint? Permille(double? share) => share == null ? null : (uint?)Math.Min(1e6, Math.Round(1000 * share.Value));

        private static double Luminance(IList<float> rgb) => 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
    }
}
