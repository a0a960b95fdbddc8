function [r, J] = nlvib_residual(x, Om, system_, H, N, others)
% Residual of NLvib's HB_residual at one frequency Om [rad/s], with forces besides those of harmonic 1, and its derivative.
    [r, dr] = HB_residual([x; Om], system_, H, N, 'frf');
    r = r - others;
    J = dr(:, 1:end-1);
end
