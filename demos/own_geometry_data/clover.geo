// A film with the outline of a clover leaf, in mm.  Draw your own in its place, and name each part
// (Physical Volume) and each surface that the scene needs (Physical Surface).
SetFactory("OpenCASCADE");
radius = 4;
thickness = 0.5;
For k In {0:2}
  Disk(k + 1) = {radius * Cos(2 * Pi * k / 3), radius * Sin(2 * Pi * k / 3), 0, radius};
EndFor
leaf() = BooleanUnion{ Surface{1}; Delete; }{ Surface{2, 3}; Delete; };
film() = Extrude{0, 0, thickness}{ Surface{leaf(0)}; };
all() = Boundary{ Volume{film(1)}; };
Physical Volume("film") = {film(1)};
Physical Surface("bottom") = {leaf(0)};
Physical Surface("top") = {film(0)};
Physical Surface("edge") = all();
Physical Surface("edge") -= {leaf(0), film(0)};
