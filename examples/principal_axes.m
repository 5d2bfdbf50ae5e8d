% Principal Axes: a mesh, turned so that its principal axes are those of the coordinates.
%
%     octave-cli principal_axes.m MESH.off FORM.off
1;

names = argv();
in = fopen(names{1});
fgetl(in);
count = fscanf(in, "%d", 3);
vertices = fscanf(in, "%f", [3, count(1)]);
faces = fscanf(in, "%d", [4, count(2)]);
fclose(in);

vertices -= mean(vertices, 2);
[axes, ~] = eig(vertices * vertices');
axes(:, 1) *= det(axes); % a rotation, which mirrors nothing

out = fopen(names{2}, "w");
fprintf(out, "OFF\n%d %d 0\n", count(1), count(2));
fprintf(out, "%.17g %.17g %.17g\n", axes' * vertices);
fprintf(out, "%d %d %d %d\n", faces);
fclose(out);
