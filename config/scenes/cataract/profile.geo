// The lens's meridian, shared by lens.geo and capsule.geo. Metres; z is anterior; the equator is near z = 0.
// Two spheres, 10 mm (anterior) and 6 mm (posterior), joined by a rounded equator; diameter 9 mm,
// thickness 4.2 mm.
mm = 1e-3;
lens_radius = 4.5 * mm;
anterior_pole = 1.75 * mm;
anterior_radius = 10 * mm;
posterior_pole = -2.45 * mm;
posterior_radius = 6 * mm;
za = anterior_pole - anterior_radius;  // centres of the two spheres on the axis
zp = posterior_pole + posterior_radius;

// The equator's circle, radius rho about (c, zc), touches both spheres from inside and reaches lens_radius:
//   c + rho = lens_radius,  c^2 + (zc - za)^2 = (Ra - rho)^2,  c^2 + (zc - zp)^2 = (Rp - rho)^2.
// Bisection on rho, with zc from the difference of the last two.
low = 0.5 * mm;
high = 2 * mm;
For i In {1:60}
  rho = 0.5 * (low + high);
  c = lens_radius - rho;
  zc = ((anterior_radius - rho)^2 - (posterior_radius - rho)^2 + zp^2 - za^2) / (2 * (zp - za));
  If (c^2 + (zc - za)^2 < (anterior_radius - rho)^2)
    low = rho;
  Else
    high = rho;
  EndIf
EndFor

// Angles at which the circle meets the spheres.
ua = Atan2(zc - za, c);
up = Atan2(zc - zp, c);
