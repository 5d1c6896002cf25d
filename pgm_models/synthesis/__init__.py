"""Any state of a scene, rendered from any view: radiance fields of its objects, composed, and enhanced.

Vocabulary:

- A FIELD belongs to one object of the scene file and is told at points of space. VOLUMES (players, the ball, a static
  world, inserted meshes) fill a box and are sampled along rays; SURFACES (planes, the sky) meet a ray once at most. A
  VEIL is a plane that one sees through, a net: where a ray meets it, it has one sample, among those of volumes.
- CANONICAL space is that of a body in its rest pose, metres; a body's field lives there and is shared by all players of
  one skeleton.
- A SPAN is where a ray may meet a volume, from `near` to `far`, metres along the ray. It is cut into equal intervals;
  one SAMPLE stands for one interval, at its middle. Samples are PACKED: one row each, all rays and frames together.
- DENSITY is in 1/m; OPTICAL depth is density times the interval's own length, without unit; what passes it is
  exp(-optical). An interval is never stretched to the next sample.
- FEATURES are what fields give out: three of colour (0 to 1 before the enhancer), the rest for the enhancer.
- A STYLE is a code that an object wears: clothes, skin, surface. `grid` stylising gives each cell of a field its
  features before they are interpolated; `sample` stylising, the paper's, each sample afterwards.
- World, cameras and pixels are those of `pgm_data.geometry`; pictures are RGB 0 to 1, channels first.
"""
