// SPDX-License-Identifier: Apache-2.0
// Generated from proto/ranges.toml by proto/ranges_code.py: do not edit.
using Lightprobe.Messages;

namespace Lightprobe
{
    /// <summary>What proto/ranges.toml forbids in a message; null: nothing.</summary>
    internal static class Ranges
    {
        /// <summary>How far the length of a unit vector may be from 1.</summary>
        internal const double UnitTolerance = 0.002;

        internal static string Broken(Light m)
        {
            if (!(RangeCheck.Keeps(m.Direction, 3, double.MinValue, double.MaxValue, double.NegativeInfinity, true, false, false)))
                return "Light.direction: expected a unit vector of 3 numbers";
            if (!(RangeCheck.Keeps(m.Irradiance, 3, 0, double.MaxValue, double.NegativeInfinity, false, false, false)))
                return "Light.irradiance: expected 3 finite numbers, 0 or more";
            if (!(RangeCheck.IsInside(m.AngularRadiusDeg, 0, 180, double.NegativeInfinity)))
                return "Light.angular_radius_deg: expected a number, 0 to 180";
            if (!(RangeCheck.IsInside(m.DirectionSigmaDeg, 0, 180, double.NegativeInfinity)))
                return "Light.direction_sigma_deg: expected a number, 0 to 180";
            if (!(RangeCheck.IsInside(m.IrradianceSigmaPermille, double.MinValue, 1000000, double.NegativeInfinity)))
                return "Light.irradiance_sigma_permille: expected a number, 0 to 1000000";
            if (!(RangeCheck.IsInside(m.ConfidencePercent, double.MinValue, 100, double.NegativeInfinity)))
                return "Light.confidence_percent: expected a number, 0 to 100";
            if (!(RangeCheck.IsInside(m.DistanceM, double.MinValue, double.MaxValue, 0)))
                return "Light.distance_m: expected a finite number above 0";
            if (!(RangeCheck.IsInside(m.DistanceSigmaPermille, double.MinValue, 1000000, double.NegativeInfinity)))
                return "Light.distance_sigma_permille: expected a number, 0 to 1000000";
            if (!(RangeCheck.IsInside(m.NearestM, double.MinValue, double.MaxValue, 0)))
                return "Light.nearest_m: expected a finite number above 0";
            if (!(RangeCheck.Keeps(m.HalfAngleDeg, 2, 0, 180, double.NegativeInfinity, false, true, false)))
                return "Light.half_angle_deg: expected 2 numbers, 0 to 180";
            if (!(RangeCheck.Keeps(m.Axis, 3, double.MinValue, double.MaxValue, double.NegativeInfinity, true, true, false)))
                return "Light.axis: expected a unit vector of 3 numbers";
            if (!(RangeCheck.IsInside(m.DolpPercent, double.MinValue, 100, double.NegativeInfinity)))
                return "Light.dolp_percent: expected a number, 0 to 100";
            if (!(RangeCheck.IsInside(m.DolpSigmaPermille, double.MinValue, 1000000, double.NegativeInfinity)))
                return "Light.dolp_sigma_permille: expected a number, 0 to 1000000";
            if (!(RangeCheck.IsInside(m.AolpDeg, 0, 180, double.NegativeInfinity)))
                return "Light.aolp_deg: expected a number, 0 to 180";
            if (!(RangeCheck.IsInside(m.AolpSigmaDeg, 0, 180, double.NegativeInfinity)))
                return "Light.aolp_sigma_deg: expected a number, 0 to 180";
            if (!(RangeCheck.IsInside(m.ReflectionPercent, double.MinValue, 100, double.NegativeInfinity)))
                return "Light.reflection_percent: expected a number, 0 to 100";
            if (!(RangeCheck.IsInside(m.ColourSigmaPermille, double.MinValue, 1000000, double.NegativeInfinity)))
                return "Light.colour_sigma_permille: expected a number, 0 to 1000000";
            if (!(RangeCheck.IsInside(m.ShadowStrengthPermille, double.MinValue, 1000, double.NegativeInfinity)))
                return "Light.shadow_strength_permille: expected a number, 0 to 1000";
            return null;
        }

        internal static string Broken(SphericalHarmonics m)
        {
            if (!((uint)m.Kind == 1 || (uint)m.Kind == 2))
                return "SphericalHarmonics.kind: expected AMBIENT or TOTAL";
            if (!(RangeCheck.IsInside(m.Order, double.MinValue, 4, double.NegativeInfinity)))
                return "SphericalHarmonics.order: expected a number, 0 to 4";
            if (!(RangeCheck.Keeps(m.Coefficients, 3 * (m.Order + 1L) * (m.Order + 1L), double.MinValue, double.MaxValue, double.NegativeInfinity, false, false, false)))
                return "SphericalHarmonics.coefficients: expected 3 × (order + 1) × (order + 1) finite numbers";
            if (!((uint)m.Basis == 0))
                return "SphericalHarmonics.basis: expected REAL_POSITIVE";
            if (!((uint)m.Quantity == 0))
                return "SphericalHarmonics.quantity: expected RADIANCE";
            return null;
        }

        internal static string Broken(Drawn m)
        {
            if (!(RangeCheck.IsInside(m.DiffusePermille, double.MinValue, 1000000, double.NegativeInfinity)))
                return "Drawn.diffuse_permille: expected a number, 0 to 1000000";
            if (!(RangeCheck.IsInside(m.ShadowsPermille, double.MinValue, 1000000, double.NegativeInfinity)))
                return "Drawn.shadows_permille: expected a number, 0 to 1000000";
            if (!(RangeCheck.IsInside(m.GlossyPermille, double.MinValue, 1000000, double.NegativeInfinity)))
                return "Drawn.glossy_permille: expected a number, 0 to 1000000";
            if (!(RangeCheck.IsInside(m.MirrorsPermille, double.MinValue, 1000000, double.NegativeInfinity)))
                return "Drawn.mirrors_permille: expected a number, 0 to 1000000";
            return null;
        }

        internal static string Broken(Room m)
        {
            if (!(RangeCheck.Keeps(m.WallsM, 6, double.MinValue, 10000, 0, false, false, false)))
                return "Room.walls_m: expected 6 numbers above 0, 10000 at most";
            if (!(RangeCheck.Keeps(m.WallsSigmaM, 6, 0, double.MaxValue, double.NegativeInfinity, false, false, false)))
                return "Room.walls_sigma_m: expected 6 finite numbers, 0 or more";
            if (!(RangeCheck.Keeps(m.Orientation, 4, double.MinValue, double.MaxValue, double.NegativeInfinity, true, false, false)))
                return "Room.orientation: expected a unit vector of 4 numbers";
            if (!(RangeCheck.IsInside(m.ErrorPermillePerM, double.MinValue, 1000000, double.NegativeInfinity)))
                return "Room.error_permille_per_m: expected a number, 0 to 1000000";
            return null;
        }

        internal static string Broken(Estimate m)
        {
            if (!((uint)m.Frame == 0 || (uint)m.Frame == 1))
                return "Estimate.frame: expected PROBE or WORLD";
            if (!(m.Sh != null))
                return "Estimate.sh: expected it to be there";
            if (!(RangeCheck.IsInside(m.PredictedErrorPermille, double.MinValue, 1000000, double.NegativeInfinity)))
                return "Estimate.predicted_error_permille: expected a number, 0 to 1000000";
            if (!(RangeCheck.IsInside(m.RelightingSigmaPermille, double.MinValue, 1000000, double.NegativeInfinity)))
                return "Estimate.relighting_sigma_permille: expected a number, 0 to 1000000";
            if (!(RangeCheck.IsInside(m.CdM2PerUnit, double.MinValue, double.MaxValue, 0)))
                return "Estimate.cd_m2_per_unit: expected a finite number above 0";
            if (!(RangeCheck.IsInside(m.CdM2PerUnitSigmaPermille, double.MinValue, 1000000, double.NegativeInfinity)))
                return "Estimate.cd_m2_per_unit_sigma_permille: expected a number, 0 to 1000000";
            if (!(RangeCheck.IsInside(m.ScaleSigmaPermille, double.MinValue, 1000000, double.NegativeInfinity)))
                return "Estimate.scale_sigma_permille: expected a number, 0 to 1000000";
            if (!(RangeCheck.IsInside(m.WheelDeg, double.MinValue, double.MaxValue, double.NegativeInfinity)))
                return "Estimate.wheel_deg: expected a finite number";
            if (!(RangeCheck.IsInside(m.WheelSigmaDeg, 0, double.MaxValue, double.NegativeInfinity)))
                return "Estimate.wheel_sigma_deg: expected a finite number, 0 or more";
            if (!(RangeCheck.Keeps(m.Orientation, 4, double.MinValue, double.MaxValue, double.NegativeInfinity, true, true, false)))
                return "Estimate.orientation: expected a unit vector of 4 numbers";
            if (!(RangeCheck.IsInside(m.OrientationSigmaDeg, 0, 180, double.NegativeInfinity)))
                return "Estimate.orientation_sigma_deg: expected a number, 0 to 180";
            if (!(RangeCheck.Keeps(m.Position, 3, double.MinValue, double.MaxValue, double.NegativeInfinity, false, true, false)))
                return "Estimate.position: expected 3 finite numbers";
            foreach (var one in m.Lights)
                if (Broken(one) is string told) return told;
            if (m.Sh != null && Broken(m.Sh) is string ofSh)
                return ofSh;
            if (m.Key != null && Broken(m.Key) is string ofKey)
                return ofKey;
            if (m.Drawn != null && Broken(m.Drawn) is string ofDrawn)
                return ofDrawn;
            if (m.Room != null && Broken(m.Room) is string ofRoom)
                return ofRoom;
            return null;
        }

        internal static string Broken(Wheel m)
        {
            if (!(RangeCheck.IsInside(m.CommandedDeg, double.MinValue, double.MaxValue, double.NegativeInfinity)))
                return "Wheel.commanded_deg: expected a finite number";
            if (!(RangeCheck.IsInside(m.MeasuredDeg, double.MinValue, double.MaxValue, double.NegativeInfinity)))
                return "Wheel.measured_deg: expected a finite number";
            if (!(RangeCheck.IsInside(m.SigmaDeg, 0, double.MaxValue, double.NegativeInfinity)))
                return "Wheel.sigma_deg: expected a finite number, 0 or more";
            if (!(RangeCheck.IsInside(m.ClockSigmaUs, 0, double.MaxValue, double.NegativeInfinity)))
                return "Wheel.clock_sigma_us: expected a finite number, 0 or more";
            return null;
        }

        internal static string Broken(Ring m)
        {
            if (!(RangeCheck.Keeps(m.IlluminanceLux, 9, 0, double.MaxValue, double.NegativeInfinity, false, false, true)))
                return "Ring.illuminance_lux: expected 9 numbers, 0 or more or NaN";
            if (!(RangeCheck.IsInside(m.SamplesPerS, 0, double.MaxValue, double.NegativeInfinity)))
                return "Ring.samples_per_s: expected a finite number, 0 or more";
            return null;
        }

        internal static string Broken(Health m)
        {
            if (!(RangeCheck.IsInside(m.EstimatesPerS, 0, double.MaxValue, double.NegativeInfinity)))
                return "Health.estimates_per_s: expected a finite number, 0 or more";
            if (!(RangeCheck.IsInside(m.CpuPercent, 0, double.MaxValue, double.NegativeInfinity)))
                return "Health.cpu_percent: expected a finite number, 0 or more";
            if (m.Wheel != null && Broken(m.Wheel) is string ofWheel)
                return ofWheel;
            if (m.Ring != null && Broken(m.Ring) is string ofRing)
                return ofRing;
            return null;
        }

        internal static string Broken(ReflectionMap m)
        {
            if (!((uint)m.Kind == 1 || (uint)m.Kind == 2))
                return "ReflectionMap.kind: expected AMBIENT or TOTAL";
            if (!((uint)m.Size == 16 || (uint)m.Size == 32 || (uint)m.Size == 64))
                return "ReflectionMap.size: expected 16, 32 or 64";
            if (!(RangeCheck.IsInside(m.Scale, double.MinValue, double.MaxValue, 0)))
                return "ReflectionMap.scale: expected a finite number above 0";
            if (!(RangeCheck.Keeps(m.Orientation, 4, double.MinValue, double.MaxValue, double.NegativeInfinity, true, true, false)))
                return "ReflectionMap.orientation: expected a unit vector of 4 numbers";
            if (!(m.Texels.Length == 24 * (m.Size + 0L) * (m.Size + 0L)))
                return "ReflectionMap.texels: expected 24 × size × size bytes";
            if (m.Drawn != null && Broken(m.Drawn) is string ofDrawn)
                return ofDrawn;
            return null;
        }

        internal static string Broken(PolarizationMap m)
        {
            if (!(RangeCheck.IsInside(m.Width, 1, 1024, double.NegativeInfinity)))
                return "PolarizationMap.width: expected a number, 1 to 1024";
            if (!(RangeCheck.IsInside(m.Height, 1, 1024, double.NegativeInfinity)))
                return "PolarizationMap.height: expected a number, 1 to 1024";
            if (!(RangeCheck.IsInside(m.S0Unit, double.MinValue, double.MaxValue, 0)))
                return "PolarizationMap.s0_unit: expected a finite number above 0";
            if (!(m.Cells.Length == 8 * (m.Width + 0L) * (m.Height + 0L)))
                return "PolarizationMap.cells: expected 8 × width × height bytes";
            return null;
        }

        internal static string Broken(FromProbe m)
        {
            if (m.Estimate != null && Broken(m.Estimate) is string ofEstimate)
                return ofEstimate;
            if (m.Health != null && Broken(m.Health) is string ofHealth)
                return ofHealth;
            if (m.ReflectionMap != null && Broken(m.ReflectionMap) is string ofReflectionMap)
                return ofReflectionMap;
            if (m.PolarizationMap != null && Broken(m.PolarizationMap) is string ofPolarizationMap)
                return ofPolarizationMap;
            return null;
        }
    }
}
