!  Flights between impacts of a linear system under one harmonic load, for AUTO-07p (IPS = 4).
!
!  Each of the flights of an orbit's period is mapped to [0, 1]. Of its 2 n + 1 unknowns the first are displacements and velocities, the last
!  is the time. PAR(1) is the frequency w, PAR(20 + i) the time of flight i. forced_flights.start holds n, the number of flights, whether
!  points are kept, the periods of the load in the orbit; w; flight times; u'' by u and u'; u'' by the load's cosine and sine, and its
!  harmonic; for each impact, at the end of flight i, its row, bound, direction of the impulse and 1 + restitution; and the starts of flights.

      MODULE FORCED
      IMPLICIT NONE
      INTEGER :: N, FLIGHTS, KEEP, PERIODS
      DOUBLE PRECISION :: HARMONIC
      DOUBLE PRECISION, ALLOCATABLE :: RATE(:,:), WAVE(:,:), ROW(:,:), BOUND(:), PUSH(:,:), JUMP(:)
      END MODULE FORCED

      SUBROUTINE FUNC(NDIM,U,ICP,PAR,IJAC,F,DFDU,DFDP)
      USE FORCED
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM, ICP(*), IJAC
      DOUBLE PRECISION, INTENT(IN) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(OUT) :: F(NDIM)
      DOUBLE PRECISION, INTENT(INOUT) :: DFDU(NDIM,NDIM), DFDP(NDIM,*)
      INTEGER I, B, S
      DOUBLE PRECISION W, T, ANGLE, FORCE(N), SLOPE(N)

      W = HARMONIC*PAR(1)
      IF (IJAC /= 0) DFDU = 0.D0
      IF (IJAC == 2) DFDP(1:NDIM,1) = 0.D0
      DO I = 1, FLIGHTS
        B = (2*N + 1)*(I - 1)
        S = B + 2*N + 1
        T = PAR(20+I)
        ANGLE = W*U(S)
        FORCE = WAVE(:,1)*COS(ANGLE) + WAVE(:,2)*SIN(ANGLE)
        F(B+1:B+N) = T*U(B+N+1:B+2*N)
        F(B+N+1:B+2*N) = T*(MATMUL(RATE,U(B+1:B+2*N)) + FORCE)
        F(S) = T
        IF (IJAC == 0) CYCLE
        SLOPE = WAVE(:,2)*COS(ANGLE) - WAVE(:,1)*SIN(ANGLE)
        CALL DIAGONAL(NDIM,B,T,DFDU)
        DFDU(B+N+1:B+2*N,B+1:B+2*N) = T*RATE
        DFDU(B+N+1:B+2*N,S) = T*W*SLOPE
        IF (IJAC == 1) CYCLE
        DFDP(1:NDIM,20+I) = 0.D0
        DFDP(B+1:S,20+I) = F(B+1:S)/T
        DFDP(B+N+1:B+2*N,1) = T*HARMONIC*U(S)*SLOPE
      ENDDO
      END SUBROUTINE FUNC

      SUBROUTINE DIAGONAL(NDIM,B,T,DFDU)
      USE FORCED
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM, B
      DOUBLE PRECISION, INTENT(IN) :: T
      DOUBLE PRECISION, INTENT(INOUT) :: DFDU(NDIM,NDIM)
      INTEGER K
      DO K = 1, N
        DFDU(B+K,B+N+K) = T
      ENDDO
      END SUBROUTINE DIAGONAL

      SUBROUTINE BCND(NDIM,PAR,ICP,NBC,U0,U1,FB,IJAC,DBC)
      USE FORCED
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM, ICP(*), NBC, IJAC
      DOUBLE PRECISION, INTENT(IN) :: PAR(*), U0(NDIM), U1(NDIM)
      DOUBLE PRECISION, INTENT(OUT) :: FB(NBC)
      DOUBLE PRECISION, INTENT(INOUT) :: DBC(NBC,*)
      INTEGER I, A, B, R, E, K, L
      DOUBLE PRECISION KICK

      IF (IJAC /= 0) DBC(1:NBC,1:2*NDIM) = 0.D0
      IF (IJAC == 2) DBC(1:NBC,2*NDIM+1) = 0.D0
      IF (IJAC == 2) DBC(1:NBC,2*NDIM+21:2*NDIM+20+FLIGHTS) = 0.D0
!     Flight i ends with an impact; the next flight, or the first one a period later, begins behind it, on the stop.
      DO I = 1, FLIGHTS
        A = (2*N + 1)*(I - 1)
        B = MOD(A + 2*N + 1, NDIM)
        R = (2*N + 2)*(I - 1)
        E = NDIM + A
        KICK = JUMP(I)*DOT_PRODUCT(ROW(:,I),U1(A+N+1:A+2*N))
        FB(R+1:R+N) = U0(B+1:B+N) - U1(A+1:A+N)
        FB(R+N+1:R+2*N) = U0(B+N+1:B+2*N) - U1(A+N+1:A+2*N) + KICK*PUSH(:,I)
        FB(R+2*N+1) = U0(B+2*N+1) - U1(A+2*N+1)
        FB(R+2*N+2) = DOT_PRODUCT(ROW(:,I),U0(B+1:B+N)) - BOUND(I)
        IF (I == FLIGHTS) FB(R+2*N+1) = FB(R+2*N+1) + PERIODS*8.D0*ATAN(1.D0)/PAR(1)
        IF (IJAC == 0) CYCLE
        DO K = 1, 2*N + 1
          DBC(R+K,B+K) = 1.D0
          DBC(R+K,E+K) = -1.D0
        ENDDO
        DO K = 1, N
          DO L = 1, N
            DBC(R+N+K,E+N+L) = DBC(R+N+K,E+N+L) + JUMP(I)*PUSH(K,I)*ROW(L,I)
          ENDDO
        ENDDO
        DBC(R+2*N+2,B+1:B+N) = ROW(:,I)
        IF (IJAC == 2 .AND. I == FLIGHTS) DBC(R+2*N+1,2*NDIM+1) = -PERIODS*8.D0*ATAN(1.D0)/PAR(1)**2
      ENDDO
      END SUBROUTINE BCND

      SUBROUTINE STPNT(NDIM,U,PAR,T)
      USE FORCED
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM
      DOUBLE PRECISION, INTENT(INOUT) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(IN) :: T
      INTEGER I

      OPEN(UNIT=77, FILE='forced_flights.start', STATUS='old')
      READ(77,*) N, FLIGHTS, KEEP, PERIODS
      IF (.NOT. ALLOCATED(RATE)) THEN
        ALLOCATE(RATE(N,2*N), WAVE(N,2), ROW(N,FLIGHTS), BOUND(FLIGHTS), PUSH(N,FLIGHTS), JUMP(FLIGHTS))
      ENDIF
      READ(77,*) PAR(1)
      READ(77,*) PAR(21:20+FLIGHTS)
      DO I = 1, N
        READ(77,*) RATE(I,:)
      ENDDO
      READ(77,*) WAVE, HARMONIC
      DO I = 1, FLIGHTS
        READ(77,*) ROW(:,I), BOUND(I), PUSH(:,I), JUMP(I)
      ENDDO
      READ(77,*) U
      CLOSE(77)
      CALL GUESS(NDIM,U,PAR,T)
      END SUBROUTINE STPNT

      INCLUDE 'common.inc'

!     Where KEEP is not 0, every point goes to forced_flights.points.
      SUBROUTINE PVLS(NDIM,U,PAR)
      USE FORCED
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM
      DOUBLE PRECISION, INTENT(IN) :: U(NDIM)
      DOUBLE PRECISION, INTENT(INOUT) :: PAR(*)

      IF (KEEP /= 0) CALL APPEND_POINT('forced_flights.points',NDIM,FLIGHTS,U,PAR)
      END SUBROUTINE PVLS
