!  An orbit of an oscillator with a sink on a spring w^p beside a linear one, for AUTO-07p: a quarter of it, from the origin to rest
!  (IPS = 4), or the closed orbit (IPS = 2). The energy of the latter is conserved; PAR(5), which multiplies the velocities, unfolds it.
!
!  U = u1, u2, u1', u2' on [0, 1]; PAR(1) is the energy h, PAR(2) mu, PAR(3) sigma, PAR(4) the odd power p, PAR(11) the time from 0 to 1.
!  PAR(6) is 0 for a quarter; 1 for a closed orbit, where AUTO scales the time itself. smooth_orbit.start holds these numbers; the first orbit
!  is in smooth_orbit.dat.

      SUBROUTINE FUNC(NDIM,U,ICP,PAR,IJAC,F,DFDU,DFDP)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM, ICP(*), IJAC
      DOUBLE PRECISION, INTENT(IN) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(OUT) :: F(NDIM)
      DOUBLE PRECISION, INTENT(INOUT) :: DFDU(NDIM,NDIM), DFDP(NDIM,*)
      DOUBLE PRECISION W, FORCE, STEEP, T
      INTEGER P

      P = NINT(PAR(4))
      T = 1.D0
      IF (PAR(6) == 0.D0) T = PAR(11)
      W = U(1) - U(2)
      STEEP = W**(P-1)
      FORCE = PAR(3)*W + STEEP*W
      F = (/ U(3), U(4), -FORCE/PAR(2) + PAR(5)*U(3), FORCE - U(2) + PAR(5)*U(4) /)
      IF (IJAC == 2) THEN
        DFDP(1:4,1) = 0.D0
        DFDP(1:4,5) = (/ 0.D0, 0.D0, U(3), U(4) /)
        DFDP(1:4,11) = F
      ENDIF
      F = T*F
      IF (IJAC == 0) RETURN
      STEEP = PAR(3) + P*STEEP
      DFDU = 0.D0
      DFDU(1,3) = T
      DFDU(2,4) = T
      DFDU(3,1) = -T*STEEP/PAR(2)
      DFDU(3,2) = T*STEEP/PAR(2)
      DFDU(4,1) = T*STEEP
      DFDU(4,2) = -T*(1.D0 + STEEP)
      DFDU(3,3) = T*PAR(5)
      DFDU(4,4) = T*PAR(5)
      END SUBROUTINE FUNC

      SUBROUTINE BCND(NDIM,PAR,ICP,NBC,U0,U1,FB,IJAC,DBC)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM, ICP(*), NBC, IJAC
      DOUBLE PRECISION, INTENT(IN) :: PAR(*), U0(NDIM), U1(NDIM)
      DOUBLE PRECISION, INTENT(OUT) :: FB(NBC)
      DOUBLE PRECISION, INTENT(INOUT) :: DBC(NBC,*)

      FB = (/ U0(1), U0(2), U1(3), U1(4), (PAR(2)*U0(3)**2 + U0(4)**2)/2.D0 - PAR(1) /)
      IF (IJAC == 0) RETURN
      DBC(1:NBC,1:2*NDIM) = 0.D0
      DBC(1,1) = 1.D0
      DBC(2,2) = 1.D0
      DBC(3,NDIM+3) = 1.D0
      DBC(4,NDIM+4) = 1.D0
      DBC(5,3) = PAR(2)*U0(3)
      DBC(5,4) = U0(4)
      IF (IJAC == 1) RETURN
      DBC(1:NBC,2*NDIM+1) = 0.D0
      DBC(1:NBC,2*NDIM+11) = 0.D0
      DBC(5,2*NDIM+1) = -1.D0
      END SUBROUTINE BCND

      SUBROUTINE STPNT(NDIM,U,PAR,T)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM
      DOUBLE PRECISION, INTENT(INOUT) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(IN) :: T
      OPEN(UNIT=77, FILE='smooth_orbit.start', STATUS='OLD')
      READ(77,*) PAR(1:6), PAR(11)
      CLOSE(77)
      END SUBROUTINE STPNT

      SUBROUTINE ICND
      END SUBROUTINE ICND

      SUBROUTINE FOPT
      END SUBROUTINE FOPT

      SUBROUTINE PVLS(NDIM,U,PAR)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM
      DOUBLE PRECISION, INTENT(IN) :: U(NDIM)
      DOUBLE PRECISION, INTENT(INOUT) :: PAR(*)
      DOUBLE PRECISION, EXTERNAL :: GETP
      DOUBLE PRECISION W

      IF (PAR(6) == 0.D0) RETURN
      W = GETP('BV0',1,U) - GETP('BV0',2,U)
      PAR(1) = (PAR(2)*GETP('BV0',3,U)**2 + GETP('BV0',4,U)**2 + GETP('BV0',2,U)**2 + PAR(3)*W**2)/2.D0
      PAR(1) = PAR(1) + ABS(W)**(NINT(PAR(4)) + 1)/(PAR(4) + 1.D0)
      END SUBROUTINE PVLS
