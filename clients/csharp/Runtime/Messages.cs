// SPDX-License-Identifier: Apache-2.0
// Generated from proto/lightprobe.proto by clients/csharp/Tools~/generate.py: do not edit.
using System;
using System.Collections.Generic;

namespace Lightprobe.Messages
{
    /// <summary>Bits of Light.flags.</summary>
    [Flags]
    public enum LightFlag : uint
    {
        None = 0,
        /// <summary>the camera saturated here: irradiance is a lower bound</summary>
        Clipped = 1,
        /// <summary>the mirror image of another lamp (glare): it lights things, but casts no shadow of its own</summary>
        Reflection = 2,
        /// <summary>an area light (a window, a soft box): wider than a lamp</summary>
        Extended = 4,
        /// <summary>strength recovered by, or direction from, the ring of light sensors; with CLIPPED: by the ring what the camera lost</summary>
        Ring = 8,
        /// <summary>not seen in the newest frame; held by the tracker's hysteresis</summary>
        Held = 16,
    }

    /// <summary>Bits of Estimate.flags: why this estimate is less than the probe at its best. 0 is a healthy one.</summary>
    [Flags]
    public enum EstimateFlag : uint
    {
        None = 0,
        /// <summary>its newest frame is older than ttl_ms: none has come since, or it came late</summary>
        Stale = 1,
        /// <summary>frames tell no exposure: light is relative, on the scale of the first estimates</summary>
        ExposureUnknown = 2,
        /// <summary>saturated pixels in every exposure used: light is missing</summary>
        Clipped = 4,
        /// <summary>most of the picture is below the noise</summary>
        Underexposed = 8,
        /// <summary>exposures of the bracket are missing, or older than the last change of light</summary>
        BracketIncomplete = 16,
        /// <summary>part of the sphere is not seen; it is filled, not measured</summary>
        PartialView = 32,
        /// <summary>more lamps found than listed; the rest is in the SH</summary>
        MoreLights = 64,
        /// <summary>NaN, infinite or negative samples were left out</summary>
        InvalidInput = 128,
        /// <summary>the governor lowered the preset to keep its budget</summary>
        Degraded = 256,
        /// <summary>no camera, or none that gives frames or sees light: estimated from the ring of light sensors alone</summary>
        RingOnly = 512,
        /// <summary>the camera did not follow the exposure command</summary>
        ExposureIgnored = 1024,
        /// <summary>the ring, or part of it, is not usable</summary>
        RingFault = 2048,
        /// <summary>the polarizer wheel is not where it should be; not used</summary>
        WheelFault = 4096,
        /// <summary>the scene is black as far as the camera can tell</summary>
        NoLight = 8192,
        /// <summary>the frames do not tell how the camera turned: directions may be off</summary>
        Motion = 16384,
        /// <summary>lamps flicker; what is reported of them is their mean</summary>
        Flicker = 32768,
        /// <summary>something covers part of the lens; what was known there is kept</summary>
        Covered = 65536,
        /// <summary>too few angles of the polarizer so far: reflections are not told from lamps</summary>
        PolarizationUnknown = 131072,
        /// <summary>the polarizing film is a quarter turn from where the wheel says</summary>
        FilmTurned = 262144,
        /// <summary>exposures contradict each other as no response explains: the camera alters parts of its pictures</summary>
        Response = 524288,
    }

    /// <summary>One lamp: a disc of the given angular radius far away.</summary>
    public sealed class Light
    {
        /// <summary>stable while the lamp is tracked; never 0</summary>
        public uint Id;
        /// <summary>x, y, z: unit vector towards the light, probe frame</summary>
        public readonly List<float> Direction = new List<float>();
        /// <summary>r, g, b: on a surface that faces the light (normal incidence)</summary>
        public readonly List<float> Irradiance = new List<float>();
        /// <summary>of the disc with the same solid angle: solid angle = 2 pi (1 - cos r)</summary>
        public float AngularRadiusDeg;
        public float? DirectionSigmaDeg;
        /// <summary>of the irradiance, all channels</summary>
        public uint? IrradianceSigmaPermille;
        /// <summary>not sent any more: it was a contrast, not a probability; see reflection_percent</summary>
        public uint? ConfidencePercent;
        /// <summary>LightFlag bits</summary>
        public uint Flags;
        /// <summary>From the probe, triangulated: from several places of a head that tells where it is (Pose.position), or by several probes (lightprobe field). Absent: not known.</summary>
        public float? DistanceM;
        /// <summary>Area lights only (LIGHT_FLAG_EXTENDED): the ellipse with the same extent. from its centre along the longer and the shorter axis</summary>
        public readonly List<float> HalfAngleDeg = new List<float>();
        /// <summary>x, y, z: unit vector along the longer axis, across direction</summary>
        public readonly List<float> Axis = new List<float>();
        /// <summary>How its light is polarized, from several angles of a polarizer in front of the lens; absent: not known. degree of linear polarization, freed of the bias of noise</summary>
        public uint? DolpPercent;
        /// <summary>angle of it, 0..180: 0 horizontal, counter-clockwise as seen from inside</summary>
        public float? AolpDeg;
        /// <summary>Probability that it is the mirror image of another lamp: above 90 it is one (LIGHT_FLAG_REFLECTION), below 10 none, in between it is unsure. Without dolp_percent place and strength alone tell.</summary>
        public uint? ReflectionPercent;
        /// <summary>1 sigma of its colour: of r, g and b, root mean square of the three, over the luminance of irradiance. irradiance_sigma_permille is that of the luminance then. Only of lamps whose strength the ring found (LIGHT_FLAG_RING): the picture hides their colour, too.</summary>
        public uint? ColourSigmaPermille;
        /// <summary>1 sigma of dolp_percent and of aolp_deg; absent: not known. 90 degrees: any angle is as likely.</summary>
        public uint? DolpSigmaPermille;
        public float? AolpSigmaDeg;
        /// <summary>Its share of the irradiance (luminance) on a surface that faces up, +Y of Estimate.frame: how dark its shadow on a table is, 0..1000. Absent: no light reaches that surface, or the probe is older than this field.</summary>
        public uint? ShadowStrengthPermille;
        /// <summary>1 sigma of distance_m, relative</summary>
        public uint? DistanceSigmaPermille;
        /// <summary>It is at least so far away, at 3 sigma: too far for a distance. Absent: distance_m is there, or nothing is known.</summary>
        public float? NearestM;

        internal static Light Read(WireReader r)
        {
            var m = new Light();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.Id = r.UInt32("Light.id"); break;
                    case 2: r.Floats("Light.direction", m.Direction); break;
                    case 3: r.Floats("Light.irradiance", m.Irradiance); break;
                    case 4: m.AngularRadiusDeg = r.Float("Light.angular_radius_deg"); break;
                    case 5: m.DirectionSigmaDeg = r.Float("Light.direction_sigma_deg"); break;
                    case 6: m.IrradianceSigmaPermille = r.UInt32("Light.irradiance_sigma_permille"); break;
                    case 7: m.ConfidencePercent = r.UInt32("Light.confidence_percent"); break;
                    case 8: m.Flags = r.UInt32("Light.flags"); break;
                    case 9: m.DistanceM = r.Float("Light.distance_m"); break;
                    case 10: r.Floats("Light.half_angle_deg", m.HalfAngleDeg); break;
                    case 11: r.Floats("Light.axis", m.Axis); break;
                    case 14: m.DolpPercent = r.UInt32("Light.dolp_percent"); break;
                    case 15: m.AolpDeg = r.Float("Light.aolp_deg"); break;
                    case 16: m.ReflectionPercent = r.UInt32("Light.reflection_percent"); break;
                    case 17: m.ColourSigmaPermille = r.UInt32("Light.colour_sigma_permille"); break;
                    case 18: m.DolpSigmaPermille = r.UInt32("Light.dolp_sigma_permille"); break;
                    case 19: m.AolpSigmaDeg = r.Float("Light.aolp_sigma_deg"); break;
                    case 20: m.ShadowStrengthPermille = r.UInt32("Light.shadow_strength_permille"); break;
                    case 21: m.DistanceSigmaPermille = r.UInt32("Light.distance_sigma_permille"); break;
                    case 22: m.NearestM = r.Float("Light.nearest_m"); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    public enum SphericalHarmonicsKind : uint
    {
        Unspecified = 0,
        /// <summary>what remains when the lights of this packet are taken out: add both</summary>
        Ambient = 1,
        /// <summary>lights included: do not add them again</summary>
        Total = 2,
    }

    public enum SphericalHarmonicsBasis : uint
    {
        RealPositive = 0,
    }

    public enum SphericalHarmonicsQuantity : uint
    {
        Radiance = 0,
    }

    /// <summary>Spherical harmonics of incident RADIANCE: L_i = integral of L(w) Y_i(w) dw, real, orthonormal. Irradiance at normal n: E(n) = sum A_l L_i Y_i(n), A = (pi, 2 pi/3, pi/4, 0, -pi/24).</summary>
    public sealed class SphericalHarmonics
    {
        public SphericalHarmonicsKind Kind;
        /// <summary>highest l; (order + 1)^2 coefficients per channel</summary>
        public uint Order;
        /// <summary>r0 g0 b0 r1 g1 b1 ...</summary>
        public readonly List<float> Coefficients = new List<float>();
        public SphericalHarmonicsBasis Basis;
        public SphericalHarmonicsQuantity Quantity;

        internal static SphericalHarmonics Read(WireReader r)
        {
            var m = new SphericalHarmonics();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.Kind = (SphericalHarmonicsKind)r.UInt32("SphericalHarmonics.kind"); break;
                    case 2: m.Order = r.UInt32("SphericalHarmonics.order"); break;
                    case 3: r.Floats("SphericalHarmonics.coefficients", m.Coefficients); break;
                    case 4: m.Basis = (SphericalHarmonicsBasis)r.UInt32("SphericalHarmonics.basis"); break;
                    case 5: m.Quantity = (SphericalHarmonicsQuantity)r.UInt32("SphericalHarmonics.quantity"); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    /// <summary>What an app draws: the most error in Subscription.draws, the error to expect in Estimate.drawn and ReflectionMap.drawn. Each is measured in its own way (docs/users/conventions.md, "What is drawn").</summary>
    public sealed class Drawn
    {
        /// <summary>light on matt surfaces, of its mean</summary>
        public uint? DiffusePermille;
        /// <summary>light in the shadow of a ball on a table, of the open light</summary>
        public uint? ShadowsPermille;
        /// <summary>what a surface of 15 degrees of blur shows, of white on a screen</summary>
        public uint? GlossyPermille;
        /// <summary>what a surface of 1.5 degrees of blur shows, of white on a screen</summary>
        public uint? MirrorsPermille;

        internal static Drawn Read(WireReader r)
        {
            var m = new Drawn();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.DiffusePermille = r.UInt32("Drawn.diffuse_permille"); break;
                    case 2: m.ShadowsPermille = r.UInt32("Drawn.shadows_permille"); break;
                    case 3: m.GlossyPermille = r.UInt32("Drawn.glossy_permille"); break;
                    case 4: m.MirrorsPermille = r.UInt32("Drawn.mirrors_permille"); break;
                    default: r.Skip(); break;
                }
            return m;
        }

        internal WireWriter Write(WireWriter w)
        {
            if (DiffusePermille.HasValue) w.UInt32(1, DiffusePermille.Value, true);
            if (ShadowsPermille.HasValue) w.UInt32(2, ShadowsPermille.Value, true);
            if (GlossyPermille.HasValue) w.UInt32(3, GlossyPermille.Value, true);
            if (MirrorsPermille.HasValue) w.UInt32(4, MirrorsPermille.Value, true);
            return w;
        }
    }

    public enum EstimateFrame : uint
    {
        Probe = 0,
        /// <summary>of the app whose head poses are used: directions and SH are turned into it</summary>
        World = 1,
    }

    public sealed class Estimate
    {
        /// <summary>counts estimates of this boot</summary>
        public uint Sequence;
        /// <summary>random per start of the daemon: sequence and ids restart with it</summary>
        public uint BootId;
        /// <summary>mid-exposure of the newest frame used</summary>
        public ulong CaptureTimeUnixNs;
        /// <summary>send time = capture time + this</summary>
        public uint SendDelayUs;
        /// <summary>older than this after capture: fade to your default</summary>
        public uint TtlMs;
        /// <summary>EstimateFlag bits</summary>
        public uint Flags;
        public EstimateFrame Frame;
        /// <summary>strongest first; of a clipped one what clipping may hide counts</summary>
        public readonly List<Light> Lights = new List<Light>();
        public SphericalHarmonics Sh;
        /// <summary>Chosen model = sh.order and the number of lights. What it leaves out, in permille of the mean irradiance over all normals (docs/users/conventions.md).</summary>
        public uint? PredictedErrorPermille;
        /// <summary>the longest exposure used</summary>
        public uint? ExposureUs;
        /// <summary>different exposures among the last frames, which this estimate is made of</summary>
        public uint ExposureCount;
        /// <summary>luminance of radiance 1; present when known within 20 %: calibrated, or by the ring</summary>
        public float? CdM2PerUnit;
        /// <summary>Angle of the polarizer wheel during the exposure of the newest frame used (docs/users/conventions.md). Measured, never assumed: absent when there is no wheel, or its angle was not known for certain.</summary>
        public float? WheelDeg;
        public float? WheelSigmaDeg;
        /// <summary>1 sigma of the irradiance as measured, in permille of its mean over all normals: noise, clipping, age, motion. Beside predicted_error_permille, which is what the model leaves out.</summary>
        public uint? RelightingSigmaPermille;
        /// <summary>1 sigma of cd_m2_per_unit, relative</summary>
        public uint? CdM2PerUnitSigmaPermille;
        /// <summary>No exposure is known (ESTIMATE_FLAG_EXPOSURE_UNKNOWN): 1 sigma of the scale of light against that of the first estimates, relative. Absent: exposures are known.</summary>
        public uint? ScaleSigmaPermille;
        /// <summary>Number of the subscription that this answers; 0: the defaults that hold until a client subscribes.</summary>
        public uint Subscription;
        /// <summary>x, y, z, w: turns the probe frame at capture time into one that does not move (docs/users/conventions.md); `frame` = WORLD: that turn has been done. Absent: not known.</summary>
        public readonly List<float> Orientation = new List<float>();
        /// <summary>about each axis</summary>
        public float? OrientationSigmaDeg;
        /// <summary>x, y, z: where the probe was at capture time, metres, in the app's world; a lamp with distance_m, turned into that world, is so far from here. Absent: not known.</summary>
        public readonly List<float> Position = new List<float>();
        /// <summary>On request: one directional light for what the listed lights leave (docs/users/conventions.md). Its id is 0. AMBIENT does not contain it: add lights, KEY and AMBIENT. TOTAL does: add none of them.</summary>
        public Light Key;
        /// <summary>Of what Subscription.draws names: what this packet and its reflection map leave out, with 2 sigma of how well the light is known. More than was asked: that cannot be had. Absent: not asked, or not known.</summary>
        public Drawn Drawn;
        /// <summary>absent: nothing is known, and the ambient light beside the probe is taken to be as here</summary>
        public Room Room;

        internal static Estimate Read(WireReader r)
        {
            var m = new Estimate();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.Sequence = r.UInt32("Estimate.sequence"); break;
                    case 2: m.BootId = r.FixedUInt32("Estimate.boot_id"); break;
                    case 3: m.CaptureTimeUnixNs = r.FixedUInt64("Estimate.capture_time_unix_ns"); break;
                    case 4: m.SendDelayUs = r.UInt32("Estimate.send_delay_us"); break;
                    case 5: m.TtlMs = r.UInt32("Estimate.ttl_ms"); break;
                    case 6: m.Flags = r.UInt32("Estimate.flags"); break;
                    case 7: m.Frame = (EstimateFrame)r.UInt32("Estimate.frame"); break;
                    case 8: m.Lights.Add(Light.Read(r.Repeated("Estimate.lights", m.Lights.Count))); break;
                    case 9: m.Sh = SphericalHarmonics.Read(r.Message("Estimate.sh")); break;
                    case 10: m.PredictedErrorPermille = r.UInt32("Estimate.predicted_error_permille"); break;
                    case 11: m.ExposureUs = r.UInt32("Estimate.exposure_us"); break;
                    case 12: m.ExposureCount = r.UInt32("Estimate.exposure_count"); break;
                    case 13: m.CdM2PerUnit = r.Float("Estimate.cd_m2_per_unit"); break;
                    case 14: m.WheelDeg = r.Float("Estimate.wheel_deg"); break;
                    case 15: m.WheelSigmaDeg = r.Float("Estimate.wheel_sigma_deg"); break;
                    case 17: m.RelightingSigmaPermille = r.UInt32("Estimate.relighting_sigma_permille"); break;
                    case 23: m.CdM2PerUnitSigmaPermille = r.UInt32("Estimate.cd_m2_per_unit_sigma_permille"); break;
                    case 24: m.ScaleSigmaPermille = r.UInt32("Estimate.scale_sigma_permille"); break;
                    case 16: m.Subscription = r.UInt32("Estimate.subscription"); break;
                    case 18: r.Floats("Estimate.orientation", m.Orientation); break;
                    case 19: m.OrientationSigmaDeg = r.Float("Estimate.orientation_sigma_deg"); break;
                    case 25: r.Floats("Estimate.position", m.Position); break;
                    case 21: m.Key = Light.Read(r.Message("Estimate.key")); break;
                    case 27: m.Drawn = Drawn.Read(r.Message("Estimate.drawn")); break;
                    case 26: m.Room = Room.Read(r.Message("Estimate.room")); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    /// <summary>The room around the probe as a box: what the ambient light is like beside the probe (docs/users/conventions.md, "Light at a place"). Absent: the probe does not move, does not know where it is, is outdoors, or no box explains what it saw.</summary>
    public sealed class Room
    {
        /// <summary>from the probe to the walls at -x +x -y +y -z +z of the box's own axes, each above 0</summary>
        public readonly List<float> WallsM = new List<float>();
        /// <summary>1 sigma of each</summary>
        public readonly List<float> WallsSigmaM = new List<float>();
        /// <summary>x, y, z, w: turns the box's axes into Estimate.frame</summary>
        public readonly List<float> Orientation = new List<float>();
        /// <summary>1 sigma of the ambient light moved by it, SH of this packet's order, for each metre from the probe: permille of the mean irradiance.</summary>
        public uint ErrorPermillePerM;

        internal static Room Read(WireReader r)
        {
            var m = new Room();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: r.Floats("Room.walls_m", m.WallsM); break;
                    case 2: r.Floats("Room.walls_sigma_m", m.WallsSigmaM); break;
                    case 3: r.Floats("Room.orientation", m.Orientation); break;
                    case 4: m.ErrorPermillePerM = r.UInt32("Room.error_permille_per_m"); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    /// <summary>What shiny surfaces mirror, on request: radiance on the six faces of a cube around the probe. A picture of the room: only if the daemon was started with --reflection-map, which Hello says. It follows the estimate whose sequence it carries; SH and lights of that one and the cube are the same light.</summary>
    public sealed class ReflectionMap
    {
        public uint Sequence;
        public uint BootId;
        public ulong CaptureTimeUnixNs;
        public uint Subscription;
        /// <summary>AMBIENT: without the lights that the estimate lists; KEY is in it. TOTAL: with them.</summary>
        public SphericalHarmonicsKind Kind;
        /// <summary>texels along each edge: 16, 32 or 64</summary>
        public uint Size;
        /// <summary>radiance = scale times what the texels say, in the units of the SH</summary>
        public float Scale;
        /// <summary>x, y, z, w: turns the probe frame, in which the cube always is, into that of Estimate.orientation.</summary>
        public readonly List<float> Orientation = new List<float>();
        /// <summary>RGB9E5, little-endian: from the lowest bit up 9 bits each of R, G, B, and 5 of the exponent e: value = mantissa * 2^(e - 24). Faces +X -X +Y -Y +Z -Z, rows and columns as OpenGL and WebXR have them (docs/users/conventions.md).</summary>
        public byte[] Texels = new byte[0];
        /// <summary>glossy and mirrors: what a map of this size leaves out, with 2 sigma of how well the light is known</summary>
        public Drawn Drawn;

        internal static ReflectionMap Read(WireReader r)
        {
            var m = new ReflectionMap();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.Sequence = r.UInt32("ReflectionMap.sequence"); break;
                    case 2: m.BootId = r.FixedUInt32("ReflectionMap.boot_id"); break;
                    case 3: m.CaptureTimeUnixNs = r.FixedUInt64("ReflectionMap.capture_time_unix_ns"); break;
                    case 4: m.Subscription = r.UInt32("ReflectionMap.subscription"); break;
                    case 5: m.Kind = (SphericalHarmonicsKind)r.UInt32("ReflectionMap.kind"); break;
                    case 6: m.Size = r.UInt32("ReflectionMap.size"); break;
                    case 7: m.Scale = r.Float("ReflectionMap.scale"); break;
                    case 8: r.Floats("ReflectionMap.orientation", m.Orientation); break;
                    case 9: m.Texels = r.Bytes("ReflectionMap.texels"); break;
                    case 10: m.Drawn = Drawn.Read(r.Message("ReflectionMap.drawn")); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    /// <summary>A coarse picture of how the light is polarized, from several angles of the polarizer: the answer to GetPolarizationMap, where the owner of the probe allows it (Hello.polarization_map). Equirectangular, probe frame at capture time: rows from above, columns from behind by the left to behind; the centre of the picture is -Z. Stokes parameters of luminance in the frame of each direction d (x = d x up, y = x x d).</summary>
    public sealed class PolarizationMap
    {
        /// <summary>mid-exposure of the newest frame used</summary>
        public ulong CaptureTimeUnixNs;
        /// <summary>cells</summary>
        public uint Width;
        public uint Height;
        public float S0Unit;
        /// <summary>Row by row four half floats (IEEE 754 binary16, little-endian) for each cell: S0 / s0_unit, S1 / S0, S2 / S0, and 1 sigma of the latter two. All four are NaN where nothing is known.</summary>
        public byte[] Cells = new byte[0];
        /// <summary>Wheel.sweeps at that time</summary>
        public ulong Sweeps;

        internal static PolarizationMap Read(WireReader r)
        {
            var m = new PolarizationMap();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.CaptureTimeUnixNs = r.FixedUInt64("PolarizationMap.capture_time_unix_ns"); break;
                    case 2: m.Width = r.UInt32("PolarizationMap.width"); break;
                    case 3: m.Height = r.UInt32("PolarizationMap.height"); break;
                    case 4: m.S0Unit = r.Float("PolarizationMap.s0_unit"); break;
                    case 5: m.Cells = r.Bytes("PolarizationMap.cells"); break;
                    case 6: m.Sweeps = r.UInt64("PolarizationMap.sweeps"); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    /// <summary>The answer to StartSweep.</summary>
    public sealed class SweepStarted
    {
        /// <summary>it is over when Wheel.sweeps has reached this</summary>
        public ulong DoneAt;

        internal static SweepStarted Read(WireReader r)
        {
            var m = new SweepStarted();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.DoneAt = r.UInt64("SweepStarted.done_at"); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    /// <summary>The answer to TakeStills.</summary>
    public sealed class StillsAsked
    {
        /// <summary>so many take a set now</summary>
        public uint Cameras;

        internal static StillsAsked Read(WireReader r)
        {
            var m = new StillsAsked();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.Cameras = r.UInt32("StillsAsked.cameras"); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    /// <summary>First message on every connection, and again when something in it changes.</summary>
    public sealed class Hello
    {
        /// <summary>differs: do not read on</summary>
        public uint ProtocolMajor;
        public uint ProtocolMinor;
        /// <summary>"lightprobed 0.1.0"</summary>
        public string Software = "";
        public uint BootId;
        /// <summary>scheme of the camera back end, never a path; "none": the ring alone</summary>
        public string Source = "";
        public uint MaxShOrder;
        public uint MaxLights;
        public uint SmoothingTimeConstantMs;
        /// <summary>source of capture_time_unix_ns</summary>
        public string Clock = "";
        public bool HasWheel;
        public bool HasRing;
        public string Preset = "";
        /// <summary>of this probe, chosen by its owner; by default its host's</summary>
        public string Name = "";
        /// <summary>anyone on the network can read it, unencrypted (--insecure-lan)</summary>
        public bool InsecureLan;
        /// <summary>what tells it: none, visual, sim (its frames, recorded or simulated), client, sensor</summary>
        public string Orientation = "";
        /// <summary>0: reflection maps are off; else anyone who may connect can ask for a picture</summary>
        public uint MaxReflectionMapSize;
        /// <summary>any client may ask for a PolarizationMap, a coarse picture (--publish-polarization)</summary>
        public bool PolarizationMap;
        /// <summary>What the cameras do to their pictures that changes the light in them, as far as they tell: sharpness, noise-reduction, dynamic-range, backlight, gamma, brightness, contrast, saturation, hue, effect, white-balance, stabilization, scene. The daemon switches off what it can (docs/users/cameras.md); this is what is on. Empty: nothing that they tell of.</summary>
        public readonly List<string> Processing = new List<string>();

        internal static Hello Read(WireReader r)
        {
            var m = new Hello();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.ProtocolMajor = r.UInt32("Hello.protocol_major"); break;
                    case 2: m.ProtocolMinor = r.UInt32("Hello.protocol_minor"); break;
                    case 3: m.Software = r.String("Hello.software"); break;
                    case 4: m.BootId = r.FixedUInt32("Hello.boot_id"); break;
                    case 5: m.Source = r.String("Hello.source"); break;
                    case 6: m.MaxShOrder = r.UInt32("Hello.max_sh_order"); break;
                    case 7: m.MaxLights = r.UInt32("Hello.max_lights"); break;
                    case 8: m.SmoothingTimeConstantMs = r.UInt32("Hello.smoothing_time_constant_ms"); break;
                    case 9: m.Clock = r.String("Hello.clock"); break;
                    case 10: m.HasWheel = r.Bool("Hello.has_wheel"); break;
                    case 11: m.HasRing = r.Bool("Hello.has_ring"); break;
                    case 12: m.Preset = r.String("Hello.preset"); break;
                    case 13: m.Name = r.String("Hello.name"); break;
                    case 14: m.InsecureLan = r.Bool("Hello.insecure_lan"); break;
                    case 15: m.Orientation = r.String("Hello.orientation"); break;
                    case 16: m.MaxReflectionMapSize = r.UInt32("Hello.max_reflection_map_size"); break;
                    case 17: m.PolarizationMap = r.Bool("Hello.polarization_map"); break;
                    case 18: r.Strings("Hello.processing", m.Processing); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    public sealed class Fault
    {
        /// <summary>docs/users/faults.md</summary>
        public string Id = "";
        /// <summary>object, stage, next step</summary>
        public string Text = "";

        internal static Fault Read(WireReader r)
        {
            var m = new Fault();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.Id = r.String("Fault.id"); break;
                    case 2: m.Text = r.String("Fault.text"); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    public enum WheelPhase : uint
    {
        Unknown = 0,
        Homing = 1,
        Moving = 2,
        Settled = 3,
        Fault = 4,
        Absent = 5,
    }

    /// <summary>The polarizer wheel, as its device reports it.</summary>
    public sealed class Wheel
    {
        public WheelPhase Phase;
        public float? CommandedDeg;
        public float? MeasuredDeg;
        public float? SigmaDeg;
        /// <summary>settled where they were commanded</summary>
        public ulong Moves;
        /// <summary>exposed at a known angle</summary>
        public ulong FramesStamped;
        /// <summary>left out: exposed while the wheel turned</summary>
        public ulong FramesMoving;
        /// <summary>used without an angle: the wheel's was not known</summary>
        public ulong FramesUnknown;
        /// <summary>of the microcontroller's clock on ours</summary>
        public float? ClockSigmaUs;
        /// <summary>resets included</summary>
        public ulong Reconnects;
        /// <summary>rounds of all angles of the polarizer that are over</summary>
        public ulong Sweeps;

        internal static Wheel Read(WireReader r)
        {
            var m = new Wheel();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.Phase = (WheelPhase)r.UInt32("Wheel.phase"); break;
                    case 2: m.CommandedDeg = r.Float("Wheel.commanded_deg"); break;
                    case 3: m.MeasuredDeg = r.Float("Wheel.measured_deg"); break;
                    case 4: m.SigmaDeg = r.Float("Wheel.sigma_deg"); break;
                    case 5: m.Moves = r.UInt64("Wheel.moves"); break;
                    case 6: m.FramesStamped = r.UInt64("Wheel.frames_stamped"); break;
                    case 7: m.FramesMoving = r.UInt64("Wheel.frames_moving"); break;
                    case 8: m.FramesUnknown = r.UInt64("Wheel.frames_unknown"); break;
                    case 9: m.ClockSigmaUs = r.Float("Wheel.clock_sigma_us"); break;
                    case 10: m.Reconnects = r.UInt64("Wheel.reconnects"); break;
                    case 11: m.Sweeps = r.UInt64("Wheel.sweeps"); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    /// <summary>The ring of light sensors (docs/users/conventions.md).</summary>
    public sealed class Ring
    {
        /// <summary>nine; NaN: this sensor is not usable</summary>
        public readonly List<float> IlluminanceLux = new List<float>();
        public float SamplesPerS;
        public ulong Samples;
        /// <summary>on the link</summary>
        public ulong SamplesLost;

        internal static Ring Read(WireReader r)
        {
            var m = new Ring();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: r.Floats("Ring.illuminance_lux", m.IlluminanceLux); break;
                    case 2: m.SamplesPerS = r.Float("Ring.samples_per_s"); break;
                    case 3: m.Samples = r.UInt64("Ring.samples"); break;
                    case 4: m.SamplesLost = r.UInt64("Ring.samples_lost"); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    public enum HealthSourceState : uint
    {
        Unknown = 0,
        Down = 1,
        Waiting = 2,
        Streaming = 3,
        Stalled = 4,
        Ended = 5,
    }

    public sealed class Health
    {
        public ulong UptimeMs;
        public HealthSourceState SourceState;
        public ulong FramesReceived;
        /// <summary>newest frame won</summary>
        public ulong FramesDropped;
        /// <summary>corrupt, wrong size, exposure not as commanded</summary>
        public ulong FramesRejected;
        public ulong SourceReconnects;
        public ulong Estimates;
        public float EstimatesPerS;
        /// <summary>frame arrival to packet sent</summary>
        public uint LatencyP50Us;
        public uint LatencyP99Us;
        public uint Clients;
        public ulong PacketsSent;
        /// <summary>a slow client lost the old, got the newest</summary>
        public ulong PacketsSuperseded;
        public ulong RequestsRejected;
        public float CpuPercent;
        public uint RssKib;
        public string Preset = "";
        public readonly List<Fault> Faults = new List<Fault>();
        /// <summary>absent: no wheel</summary>
        public Wheel Wheel;
        /// <summary>absent: no ring</summary>
        public Ring Ring;
        /// <summary>pictures that have left the probe</summary>
        public ulong PolarizationMapsSent;
        /// <summary>Places of the pictures, of all cameras, that shine by themselves: stuck pixels, or a light of the box before a lens. They are left out.</summary>
        public uint PlacesLeftOut;

        internal static Health Read(WireReader r)
        {
            var m = new Health();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.UptimeMs = r.UInt64("Health.uptime_ms"); break;
                    case 2: m.SourceState = (HealthSourceState)r.UInt32("Health.source_state"); break;
                    case 3: m.FramesReceived = r.UInt64("Health.frames_received"); break;
                    case 4: m.FramesDropped = r.UInt64("Health.frames_dropped"); break;
                    case 5: m.FramesRejected = r.UInt64("Health.frames_rejected"); break;
                    case 6: m.SourceReconnects = r.UInt64("Health.source_reconnects"); break;
                    case 7: m.Estimates = r.UInt64("Health.estimates"); break;
                    case 8: m.EstimatesPerS = r.Float("Health.estimates_per_s"); break;
                    case 9: m.LatencyP50Us = r.UInt32("Health.latency_p50_us"); break;
                    case 10: m.LatencyP99Us = r.UInt32("Health.latency_p99_us"); break;
                    case 11: m.Clients = r.UInt32("Health.clients"); break;
                    case 12: m.PacketsSent = r.UInt64("Health.packets_sent"); break;
                    case 13: m.PacketsSuperseded = r.UInt64("Health.packets_superseded"); break;
                    case 14: m.RequestsRejected = r.UInt64("Health.requests_rejected"); break;
                    case 15: m.CpuPercent = r.Float("Health.cpu_percent"); break;
                    case 16: m.RssKib = r.UInt32("Health.rss_kib"); break;
                    case 17: m.Preset = r.String("Health.preset"); break;
                    case 18: m.Faults.Add(Fault.Read(r.Repeated("Health.faults", m.Faults.Count))); break;
                    case 19: m.Wheel = Wheel.Read(r.Message("Health.wheel")); break;
                    case 20: m.Ring = Ring.Read(r.Message("Health.ring")); break;
                    case 21: m.PolarizationMapsSent = r.UInt64("Health.polarization_maps_sent"); break;
                    case 22: m.PlacesLeftOut = r.UInt32("Health.places_left_out"); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    public sealed class Error
    {
        /// <summary>negative errno; -13 (EACCES) in place of a Hello: the token is missing or wrong</summary>
        public int Code;
        /// <summary>object, stage, next step</summary>
        public string Text = "";

        internal static Error Read(WireReader r)
        {
            var m = new Error();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.Code = r.Int32("Error.code"); break;
                    case 2: m.Text = r.String("Error.text"); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    /// <summary>The answer to a Ping.</summary>
    public sealed class Pong
    {
        /// <summary>Ping.time_ns</summary>
        public long PingTimeNs;
        /// <summary>by the probe's clock, that of capture_time_unix_ns</summary>
        public ulong ReceivedUnixNs;
        public ulong SentUnixNs;

        internal static Pong Read(WireReader r)
        {
            var m = new Pong();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m.PingTimeNs = r.FixedInt64("Pong.ping_time_ns"); break;
                    case 2: m.ReceivedUnixNs = r.FixedUInt64("Pong.received_unix_ns"); break;
                    case 3: m.SentUnixNs = r.FixedUInt64("Pong.sent_unix_ns"); break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    public sealed class FromProbe
    {
        public Hello Hello;
        public Estimate Estimate;
        public Health Health;
        public Error Error;
        public Pong Pong;
        public ReflectionMap ReflectionMap;
        public PolarizationMap PolarizationMap;
        public SweepStarted SweepStarted;
        public StillsAsked StillsAsked;

        internal static FromProbe Read(WireReader r)
        {
            var m = new FromProbe();
            while (r.Next(out int field))
                switch (field)
                {
                    case 1: m = new FromProbe { Hello = Hello.Read(r.Message("FromProbe.hello")) }; break;
                    case 2: m = new FromProbe { Estimate = Estimate.Read(r.Message("FromProbe.estimate")) }; break;
                    case 3: m = new FromProbe { Health = Health.Read(r.Message("FromProbe.health")) }; break;
                    case 4: m = new FromProbe { Error = Error.Read(r.Message("FromProbe.error")) }; break;
                    case 5: m = new FromProbe { Pong = Pong.Read(r.Message("FromProbe.pong")) }; break;
                    case 6: m = new FromProbe { ReflectionMap = ReflectionMap.Read(r.Message("FromProbe.reflection_map")) }; break;
                    case 7: m = new FromProbe { PolarizationMap = PolarizationMap.Read(r.Message("FromProbe.polarization_map")) }; break;
                    case 8: m = new FromProbe { SweepStarted = SweepStarted.Read(r.Message("FromProbe.sweep_started")) }; break;
                    case 9: m = new FromProbe { StillsAsked = StillsAsked.Read(r.Message("FromProbe.stills_asked")) }; break;
                    default: r.Skip(); break;
                }
            return m;
        }
    }

    public enum SubscriptionSmoothing : uint
    {
        Smoothed = 0,
        Raw = 1,
    }

    /// <summary>What a client wants; the newest subscription holds. Absent fields mean the defaults named here.</summary>
    public sealed class Subscription
    {
        /// <summary>most packets a second; 0: every estimate</summary>
        public float RateHz;
        /// <summary>highest order wanted, 0..4; default 2</summary>
        public uint? ShOrder;
        /// <summary>default 4</summary>
        public uint? MaxLights;
        /// <summary>default AMBIENT</summary>
        public SphericalHarmonicsKind Kind;
        /// <summary>Smallest model whose predicted error stays under this; 0: the largest model allowed above.</summary>
        public uint TolerancePermille;
        public SubscriptionSmoothing Smoothing;
        /// <summary>0: no health messages</summary>
        public uint HealthPeriodMs;
        /// <summary>Chosen by the client; every estimate made for this subscription carries it. What was on its way before the subscription came carries another: drop it. The daemon does so from protocol 1.1 on.</summary>
        public uint Number;
        /// <summary>WORLD: where it is known; Estimate.frame says what it is</summary>
        public EstimateFrame Frame;
        /// <summary>Estimate.key is wanted</summary>
        public bool KeyLight;
        /// <summary>windows, soft boxes and the like may be among the lights, one ellipse each</summary>
        public bool AreaLights;
        /// <summary>Do not list mirror images (LIGHT_FLAG_REFLECTION); their light stays in the SH.</summary>
        public bool LeaveOutReflections;
        /// <summary>absent: none is sent</summary>
        public ReflectionMapWish ReflectionMap;
        /// <summary>While an estimate says nothing that the one sent last does not, it is left out: then they come this far apart, and last so much longer (Estimate.ttl_ms). What is new is sent as soon as ever: light that has changed by more than tolerance_permille (of the mean irradiance; at least by 4, a step of an 8-bit picture), other lights, other flags, a larger error. 0: nothing is left out.</summary>
        public uint QuietMs;
        /// <summary>What the app draws, and the most error of each; 0 or absent: not drawn. Then the daemon chooses the least that suffices: SH order, lights, area lights, size and rate of reflection maps. sh_order (default 4 then), max_lights (8), reflection_map (64, 5 a second) are upper bounds; key_light: KEY may be sent. Estimate.drawn says what came of it. tolerance_permille then says what is news, and no more. A daemon before protocol 1.6 knows none of this.</summary>
        public Drawn Draws;

        internal WireWriter Write(WireWriter w)
        {
            w.Float(1, RateHz);
            if (ShOrder.HasValue) w.UInt32(2, ShOrder.Value, true);
            if (MaxLights.HasValue) w.UInt32(3, MaxLights.Value, true);
            w.UInt32(4, (uint)Kind);
            w.UInt32(5, TolerancePermille);
            w.UInt32(6, (uint)Smoothing);
            w.UInt32(7, HealthPeriodMs);
            w.UInt32(8, Number);
            w.UInt32(9, (uint)Frame);
            w.Bool(10, KeyLight);
            w.Bool(11, AreaLights);
            w.Bool(13, LeaveOutReflections);
            if (ReflectionMap != null) w.Message(14, ReflectionMap.Write(new WireWriter()));
            w.UInt32(15, QuietMs);
            if (Draws != null) w.Message(16, Draws.Write(new WireWriter()));
            return w;
        }
    }

    public sealed class ReflectionMapWish
    {
        /// <summary>texels along each edge: 16, 32 or 64; 0: none</summary>
        public uint Size;
        /// <summary>most maps a second, up to 30; 0: 5</summary>
        public float RateHz;
        /// <summary>default TOTAL: a mirror shows the lamps</summary>
        public SphericalHarmonicsKind Kind;

        internal WireWriter Write(WireWriter w)
        {
            w.UInt32(1, Size);
            w.Float(2, RateHz);
            w.UInt32(3, (uint)Kind);
            return w;
        }
    }

    /// <summary>How the app's head is turned and where it is, for a probe that is mounted on it (--orientation=client).</summary>
    public sealed class Pose
    {
        /// <summary>of the client's own steady clock; what it counts from does not matter</summary>
        public long TimeNs;
        /// <summary>x, y, z, w: turns the head's frame into the app's world</summary>
        public readonly List<float> Orientation = new List<float>();
        /// <summary>1 sigma about each axis; default 0.2</summary>
        public float? SigmaDeg;
        /// <summary>x, y, z: where the head's origin is in the app's world, metres. Absent: not known; lamps get no distances then.</summary>
        public readonly List<float> Position = new List<float>();
        /// <summary>1 sigma along each axis; default 0.005</summary>
        public float? PositionSigmaM;

        internal WireWriter Write(WireWriter w)
        {
            w.FixedInt64(1, TimeNs);
            w.Floats(2, Orientation);
            if (SigmaDeg.HasValue) w.Float(3, SigmaDeg.Value, true);
            w.Floats(4, Position);
            if (PositionSigmaM.HasValue) w.Float(5, PositionSigmaM.Value, true);
            return w;
        }
    }

    /// <summary>Measures how far the client's clock is off the probe's, in both directions; once a second is enough.</summary>
    public sealed class Ping
    {
        /// <summary>of the same clock as Pose.time_ns, now</summary>
        public long TimeNs;
        /// <summary>when the answer to the ping before came; absent: none has come</summary>
        public long? PongTimeNs;

        internal WireWriter Write(WireWriter w)
        {
            w.FixedInt64(1, TimeNs);
            if (PongTimeNs.HasValue) w.FixedInt64(2, PongTimeNs.Value, true);
            return w;
        }
    }

    /// <summary>One PolarizationMap is wanted. It comes with the next frame, at most two in a second; Error where the probe has none to give.</summary>
    public sealed class GetPolarizationMap
    {

        internal WireWriter Write(WireWriter w)
        {
            return w;
        }
    }

    /// <summary>The polarizer is to visit all its angles now, even if it rests (--polarizer-rest). Error where it cannot.</summary>
    public sealed class StartSweep
    {

        internal WireWriter Write(WireWriter w)
        {
            return w;
        }
    }

    /// <summary>Cameras for stills (ptp:) are to take a set now. It counts some seconds later, when it has come. Error where there is none, or none is ready.</summary>
    public sealed class TakeStills
    {

        internal WireWriter Write(WireWriter w)
        {
            return w;
        }
    }

    public sealed class FromClient
    {
        public Subscription Subscribe;
        public Pose Pose;
        public Ping Ping;
        public GetPolarizationMap GetPolarizationMap;
        public StartSweep StartSweep;
        public TakeStills TakeStills;

        internal WireWriter Write(WireWriter w)
        {
            if (Subscribe != null) w.Message(1, Subscribe.Write(new WireWriter()));
            if (Pose != null) w.Message(2, Pose.Write(new WireWriter()));
            if (Ping != null) w.Message(3, Ping.Write(new WireWriter()));
            if (GetPolarizationMap != null) w.Message(4, GetPolarizationMap.Write(new WireWriter()));
            if (StartSweep != null) w.Message(5, StartSweep.Write(new WireWriter()));
            if (TakeStills != null) w.Message(6, TakeStills.Write(new WireWriter()));
            return w;
        }
    }
}
